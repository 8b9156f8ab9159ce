"""Many stations on many computers: each computer's stations are published, and followed from any other, over Zenoh.

Needs the extra `fleet`. The keys are in `fleet_keys`, what a message holds in `run_words`.
"""
