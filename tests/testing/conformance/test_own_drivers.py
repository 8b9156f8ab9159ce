"""Drivers without a counterpart under the kit."""

from __future__ import annotations

import sys

import pytest

from conformance.subjects import simulated
from umo.drivers.timerfd import TimerFd
from umo.testing.conformance import Input, Subject, conform

CYCLES = 100


def test_the_simulated_circuit(most_rules: list[str]) -> None:
    certificate = conform(simulated(), cycles=CYCLES, only=most_rules)
    assert certificate.passed, str(certificate)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="timerfd is a part of Linux")
def test_the_timer(most_rules: list[str]) -> None:
    subject = Subject("timerfd", make=TimerFd, inputs=(Input("tick", steady=False),), device="the clock of Linux")
    certificate = conform(subject, cycles=CYCLES, only=most_rules)
    assert certificate.passed, str(certificate)
