"""Faces for MQTT brokers: Sparkplug B (`umo.faces.mqtt.sparkplug`) and Home Assistant (`umo.faces.mqtt.home_assistant`).

They are two, as a connection has one will: that of Sparkplug is NDEATH, that of Home Assistant makes all unavailable.
"""
