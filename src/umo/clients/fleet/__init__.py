"""Connects the stations of many computers over Zenoh: each computer publishes its stations, and any other computer can
follow them.

This package needs the extra `fleet`. `fleet_keys` defines the keys of messages, and `run_words` their contents.
"""
