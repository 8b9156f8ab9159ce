"""A controller that has lost its host brakes its axis, and then brings its outputs to their defaults, in time."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from helpers.generating import needs_a_compiler
from helpers.paced_theta import PacedTheta, Period, paced_theta
from helpers.split_axis import DEFAULTS, HOST_GONE, TIMEOUT_PERIODS
from umo.split.link_bodies import FrameKind

pytestmark = needs_a_compiler
DT, RUNNING, BRAKING = 0.002, 1, 4
ACCELERATION, JERK = 300.0, 3_000.0
QUIET = TIMEOUT_PERIODS - 1
"""Periods without a word in which the axis moves on: that of the last word counts, too."""
SHORT = 40
"""Periods of a braking timeout that is too short."""


@pytest.fixture
def theta(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[PacedTheta]:
    options = {"braking_timeout": request.param} if hasattr(request, "param") else {}
    with paced_theta(tmp_path, **options) as found:
        yield found


def cruising(theta: PacedTheta, velocity: float = 40.0) -> Period:
    """The host has set the axis in motion, and said something last."""
    theta.axis.profile.at(velocity)
    theta.start()
    for _ in range(300):
        theta.step(theta.request(FrameKind.EXCHANGE))
    return theta.step(theta.request(FrameKind.EXCHANGE))


def silent(theta: PacedTheta, periods: int = 1_000) -> list[Period]:
    """The periods after the last word of the host, until its outputs are at their defaults for good."""
    found = []
    for _ in range(periods):
        found.append(theta.step())
        if found[-1].mode == HOST_GONE:
            break
    return found


def test_an_axis_that_moves_brakes_within_its_limits_and_then_outputs_go_to_defaults(theta: PacedTheta) -> None:
    assert cruising(theta).setpoint.velocity == pytest.approx(40.0)
    found = silent(theta)
    assert [each.mode for each in found[: QUIET + 1]] == [RUNNING] * QUIET + [BRAKING]
    braking = [each.setpoint for each in found[QUIET - 1 : -1]]
    needed = 40.0 / ACCELERATION + ACCELERATION / JERK
    assert len(braking) - 1 == pytest.approx(needed / DT, abs=2)
    assert braking[-1][1:] == (0.0, 0.0)
    for before, after in pairwise(braking):
        assert 0.0 >= after.velocity - before.velocity >= -ACCELERATION * DT * 1.001
        assert abs(after.acceleration - before.acceleration) <= JERK * DT * 1.001
    assert sum(each.outputs[0] for each in found[QUIET:-1]) > 10  # it steps while it brakes
    assert (found[-1].mode, found[-1].outputs) == (HOST_GONE, DEFAULTS)
    assert theta.step().outputs == DEFAULTS


def test_an_axis_that_stands_is_at_its_defaults_at_the_host_timeout(theta: PacedTheta) -> None:
    cruising(theta, 0.0)
    found = silent(theta)
    assert [each.mode for each in found] == [RUNNING] * QUIET + [HOST_GONE]
    assert found[-1].outputs == DEFAULTS


@pytest.mark.parametrize("theta", [SHORT * DT], indirect=True)
def test_a_braking_that_takes_too_long_ends_at_the_declared_time(theta: PacedTheta) -> None:
    cruising(theta)
    found = silent(theta)
    assert len(found) == QUIET + SHORT + 1
    assert found[-2].setpoint.velocity > 1.0
    assert found[-1].outputs == DEFAULTS


@pytest.mark.parametrize("theta", [0], indirect=True)
def test_without_a_braking_timeout_the_outputs_go_to_their_defaults_at_once(theta: PacedTheta) -> None:
    cruising(theta)
    assert [each.mode for each in silent(theta)] == [RUNNING] * QUIET + [HOST_GONE]


def test_periods_that_are_missed_while_it_brakes_are_counted(theta: PacedTheta) -> None:
    cruising(theta)
    for _ in range(QUIET + 5):
        theta.step()
    assert theta.step(ticks=100).setpoint.velocity < 1.0  # a stepper stands by then
    assert theta.step(ticks=401).mode == HOST_GONE


def test_a_host_that_comes_back_starts_the_axis_once_it_stands(theta: PacedTheta) -> None:
    cruising(theta)
    for _ in range(QUIET + 5):
        theta.step()
    assert theta.step(theta.request(FrameKind.EXCHANGE)).answers == []  # the session is over
    session = theta.greet()
    refused = theta.step(theta.request(FrameKind.START, session=session))
    assert (refused.mode, refused.answers) == (BRAKING, [])
    silent(theta)
    assert theta.step(theta.request(FrameKind.START, session=session)).mode == RUNNING


def test_a_stop_is_carried_out_at_once_while_it_brakes(theta: PacedTheta) -> None:
    cruising(theta)
    for _ in range(QUIET + 5):
        theta.step()
    stopped = theta.step(theta.request(FrameKind.STOP, session=theta.greet()))
    assert (stopped.mode, stopped.outputs) == (0, DEFAULTS)


def test_a_moving_axis_that_misses_periods_asks_for_a_plan_and_brakes_meanwhile(theta: PacedTheta) -> None:
    before = cruising(theta)
    late = theta.step(theta.request(FrameKind.EXCHANGE), ticks=30)
    assert before.setpoint.velocity == pytest.approx(40.0)
    assert late.mode == RUNNING
    assert int.from_bytes(late.answers[0][14:16], "little") == 1  # what the host is asked to plan
    assert theta.step(theta.request(FrameKind.EXCHANGE)).setpoint.velocity == 0.0  # a stepper stands by then
