"""The conformance kit in the guest."""

from __future__ import annotations

from umo.testing.conformance import Subject, conform

CYCLES = 600
"""tracemalloc makes a cycle 100 times slower in the guest; test_gpio.py repeats 15,000 without it."""

MINUTES = 0.5
"""The time limit of a test is 1 min."""


def proved(subject: Subject) -> None:
    """`--umo-certificates DIR` keeps the certificate."""
    certificate = conform(subject, cycles=CYCLES, minutes=MINUTES)
    assert certificate.passed, certificate
