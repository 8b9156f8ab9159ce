"""Many stations on many computers: each computer's stations are published, and followed from any other, over Zenoh.

Needs the extra `fleet`. `fleet_keys` has the keys, `run_words` the contents of the messages.
"""
