"""Stores runs and shows them again: recordings with the exact values of every period, replay, tables, and samples
against time (`recording.scope`). `umo.process.frames` has the data that a run publishes while it runs."""
