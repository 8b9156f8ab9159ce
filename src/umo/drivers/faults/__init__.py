"""Faults injected on purpose between a machine and its drivers (`umo.testing.faults`)."""
