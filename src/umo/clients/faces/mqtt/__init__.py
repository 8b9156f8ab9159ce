"""Faces for MQTT brokers: Sparkplug B (`sparkplug`) and Home Assistant (`home_assistant`).

They are two, as a connection has one will: that of Sparkplug is NDEATH, that of Home Assistant makes all unavailable.
"""
