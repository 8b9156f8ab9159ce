"""Runs that are kept, and looked at again: recordings with the exact values of every period, replay, tables, and
samples against time (`recording.scope`). What a run publishes while it runs is in `umo.process.frames`."""
