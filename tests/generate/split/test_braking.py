"""A controller that has lost its host brakes its axis, and then brings its outputs to their defaults, in time."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

from helpers.generating import needs_a_compiler
from helpers.machines import timer
from helpers.paced_controller import PacedController, Period, enable, paced, paced_theta
from helpers.slide import stepper
from helpers.split_parts import BRAKING_PERIODS, HOST_GONE, THETA, TIMEOUT_PERIODS
from umo import Compound, DigitalSensor
from umo.control import StepperAxis
from umo.generate.split.link_bodies import ControllerMode, FrameItem, FrameKind, item

pytestmark = needs_a_compiler
DT, RUNNING, BRAKING = 0.002, 1, 4
ACCELERATION, JERK = 300.0, 3_000.0
QUIET = TIMEOUT_PERIODS - 1
"""Periods without a word in which the axis moves on: that of the last word counts, too."""
SHORT = 40
"""Periods of a braking timeout that is too short."""


class Theta(NamedTuple):
    """The controller, and the axis in Python."""

    controller: PacedController
    axis: StepperAxis


@pytest.fixture
def theta(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Theta]:
    options = {"braking_timeout": request.param} if hasattr(request, "param") else {}
    folder = tmp_path_factory.getbasetemp() / f"braking-{'-'.join(map(str, options.values()))}"
    with paced_theta(folder, **options) as (controller, axis):
        yield Theta(controller, axis)


def cruising(theta: Theta, velocity: float = 40.0) -> Period:
    """The host has set the axis in motion, and said something last."""
    theta.axis.profile.at(velocity)
    theta.controller.start()
    for _ in range(300):
        theta.controller.step(theta.controller.request(FrameKind.EXCHANGE))
    return theta.controller.step(theta.controller.request(FrameKind.EXCHANGE))


def silent(theta: Theta, periods: int = 1_000) -> list[Period]:
    """The periods after the last word of the host, until its outputs are at their defaults for good."""
    found = []
    for _ in range(periods):
        found.append(theta.controller.step())
        if found[-1].mode == HOST_GONE:
            break
    return found


@pytest.mark.full
def test_an_axis_that_moves_brakes_within_its_limits_and_then_outputs_go_to_defaults(theta: Theta) -> None:
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
    assert (found[-1].mode, found[-1].outputs) == (HOST_GONE, THETA.defaults)
    assert theta.controller.step().outputs == THETA.defaults


@pytest.mark.full
def test_an_axis_that_stands_is_at_its_defaults_at_the_host_timeout(theta: Theta) -> None:
    cruising(theta, 0.0)
    found = silent(theta)
    assert [each.mode for each in found] == [RUNNING] * QUIET + [HOST_GONE]
    assert found[-1].outputs == THETA.defaults


@pytest.mark.parametrize("theta", [SHORT * DT], indirect=True)
@pytest.mark.full
def test_a_braking_that_takes_too_long_ends_at_the_declared_time(theta: Theta) -> None:
    cruising(theta)
    found = silent(theta)
    assert len(found) == QUIET + SHORT + 1
    assert found[-2].setpoint.velocity > 1.0
    assert found[-1].outputs == THETA.defaults


@pytest.mark.parametrize("theta", [0], indirect=True)
@pytest.mark.full
def test_without_a_braking_timeout_the_outputs_go_to_their_defaults_at_once(theta: Theta) -> None:
    cruising(theta)
    assert [each.mode for each in silent(theta)] == [RUNNING] * QUIET + [HOST_GONE]


def test_periods_that_are_missed_while_it_brakes_are_counted(theta: Theta) -> None:
    cruising(theta)
    for _ in range(QUIET + 5):
        theta.controller.step()
    late = theta.controller.step(ticks=BRAKING_PERIODS)
    assert (late.mode, late.outputs) == (HOST_GONE, THETA.defaults)


def test_a_host_that_comes_back_starts_the_axis_once_it_stands(theta: Theta) -> None:
    cruising(theta)
    for _ in range(QUIET + 5):
        theta.controller.step()
    assert theta.controller.step(theta.controller.request(FrameKind.EXCHANGE)).answers == []  # the session is over
    session = theta.controller.greet()
    refused = theta.controller.step(theta.controller.request(FrameKind.START, session=session))
    assert (refused.mode, refused.answers) == (BRAKING, [])
    silent(theta)
    assert theta.controller.step(theta.controller.request(FrameKind.START, session=session)).mode == RUNNING


def test_a_stop_is_carried_out_at_once_while_it_brakes(theta: Theta) -> None:
    cruising(theta)
    for _ in range(QUIET + 5):
        theta.controller.step()
    stopped = theta.controller.step(theta.controller.request(FrameKind.STOP, session=theta.controller.greet()))
    assert (stopped.mode, stopped.outputs) == (0, THETA.defaults)


class Stage(Compound):
    x: StepperAxis
    y: StepperAxis


class Bench(Compound):
    stage: Stage
    timer: DigitalSensor


@pytest.mark.full
def test_axes_that_miss_periods_brake_and_the_host_is_asked_for_a_plan_of_each(tmp_path: Path) -> None:
    bench = Bench(stage=Stage(x=stepper(following_error=1e3), y=stepper(following_error=1e3)), timer=timer())
    wire = {"timer": {"driver": "timerfd", "period": "2 ms"}, "stage": {"controller": "drive"}}
    drive = {"type": "umo.generate.split.controller_driver:Controller", "port": 1}
    with paced(tmp_path, bench, {"drivers": {"drive": drive}, "wire": wire}, bench.stage, "stage_x_profile") as c:
        for axis in (bench.stage.x, bench.stage.y):
            enable(axis)
            axis.profile.at(10.0)
        c.start()
        for _ in range(200):
            assert c.exchange().asks == 0
        first = c.exchange(ticks=30)
        assert (first.mode, first.asks) == (ControllerMode.RUNNING, 1)
        assert c.step(c.request(FrameKind.EXCHANGE)).setpoint.velocity == 0.0  # a stepper stands by then
        second = c.exchange(item(FrameItem.PLANNED, 1))
        assert second.asks == 2
        assert {first.call, second.call} == {0, 1}
        assert c.exchange(item(FrameItem.PLANNED, 1)).asks == 2  # said again
        assert c.exchange(item(FrameItem.PLANNED, 2)).asks == 0
