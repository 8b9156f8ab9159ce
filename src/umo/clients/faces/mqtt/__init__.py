"""Faces for MQTT brokers: Sparkplug B (`sparkplug`) and Home Assistant (`home_assistant`).

They are separate faces because an MQTT connection has only one will. The will of Sparkplug is NDEATH; the will of Home
Assistant marks everything as unavailable.
"""
