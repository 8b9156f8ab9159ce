"""Axes after missed periods: the limits of a motion hold, whatever is missed, and the axis arrives."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from itertools import pairwise
from math import inf
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import umo
from helpers.machines import timer
from helpers.slide import DT, Slide, servo, stepper
from helpers.tiers import budget
from umo import Compound, DigitalSensor
from umo.control import Axis, next_period, wait
from umo.control.profile import Setpoint
from umo.drivers import Channel
from umo.errors import AxisError
from umo.objects import atoms

LIMITS: dict[str, Any] = {"acceleration": 1_500.0, "velocity": 250.0, "jerk": 30_000.0}
GAINS: dict[str, Any] = {"gain": 0.4, "integral_time": 0.1, "feed_forward": 1 / 50, "inertia": 1 / 50 * 0.01}


class Rail(Compound):
    x: Axis
    timer: DigitalSensor


class Late(Slide):
    """Now and then many periods are missed. `still`: the slide stands meanwhile, as a plant in virtual time may. It has
    no end stops."""

    def __init__(self, missed: dict[int, int], still: bool = False) -> None:
        super().__init__(10.0)
        self.missed, self.still, self.number = missed, still, 0
        self.rates: list[float] = []

    def _go(self, position: float) -> None:
        self.position = position

    def read(self, channel: Channel) -> int:
        if channel.text != "tick":
            return super().read(channel)
        self.number += 1
        missed = self.missed.get(self.number, 0)
        for _ in range(1 if self.still else max(1, missed)):
            self.advance()
        self.rates.append(self.rate)
        return missed


def run(
    axis: Axis, slide: Slide, work: Callable[[Rail], Coroutine[Any, Any, Any]], beyond: float = 10.0
) -> list[Setpoint]:
    """Reference the axis and do the work; the setpoints of all periods in which it was enabled."""
    m = Rail(x=axis, timer=timer())
    on = {"x.motor": "motor", "x.step": "step", "x.direction": "direction", "x.encoder": "counter", "timer": "tick"}
    wire: dict[str, Any] = {item.path: {"driver": "slide", "channel": on[item.path]} for item in atoms(m)}
    wire["timer"]["period"] = DT
    setpoints: list[Setpoint] = []

    async def all_of_it(m: Rail) -> None:
        await next_period()
        m.x.encoder.referenced(at=beyond)
        await work(m)

    connection = umo.connect(m, {"drivers": {"slide": slide}, "wire": wire})
    with connection:
        connection.machine.observers.append(lambda _: setpoints.append(m.x.profile.setpoint) if m.x.enabled else None)
        umo.drive(m, all_of_it)
    return setpoints


def steps(numbers: list[float]) -> list[float]:
    return [after - before for before, after in pairwise(numbers)]


@pytest.mark.parametrize("still", [False, True])
@pytest.mark.parametrize("at", [20, 60, 130, 200, 300, 330, 420])
def test_a_motion_keeps_its_limits_after_missed_periods_and_arrives(at: int, still: bool) -> None:
    slide = Late({at: 100}, still)
    setpoints = run(servo(inertia=1 / 50 * 0.01, acceleration=1_000.0), slide, lambda m: m.x.move_to(70.0))
    assert slide.position == pytest.approx(70.0, abs=0.06)
    assert max(abs(each.velocity) for each in setpoints) <= 200.0 * 1.001
    assert max(abs(each.acceleration) for each in setpoints) <= 1_000.0 * 1.001
    assert max(map(abs, steps([each.velocity for each in setpoints]))) <= 1_000.0 * DT * 1.001
    assert max(map(abs, slide.rates)) <= 200.0 * 1.1
    felt = [abs(step) / DT for step in steps(slide.rates)]
    assert max(rate for number, rate in enumerate(felt, 2) if number != at) <= 1_000.0 * 1.1


MISSED = st.dictionaries(st.integers(1, 800), st.integers(2, 120), max_size=8)
"""Numbers of missed periods, by the number of the look at the timer."""


@budget(12, 40)
@given(missed=MISSED, target=st.sampled_from([10.5, 12.0, 30.0, 60.0]))
@example(missed={33: 109, 174: 120, 84: 28, 209: 108}, target=12.0)
@example(missed={71: 28, 218: 80, 252: 85, 423: 106, 483: 31}, target=30.0)  # it moves on beyond the window at the end
def test_a_servo_keeps_its_limits_whatever_is_missed(missed: dict[int, int], target: float) -> None:
    slide = Late(missed)
    setpoints = run(servo(**LIMITS | GAINS), slide, lambda m: m.x.move_to(target))
    assert slide.position == pytest.approx(target, abs=0.06)
    assert max(abs(each.velocity) for each in setpoints) <= 250.0 * 1.001
    assert max(abs(each.acceleration) for each in setpoints) <= 1_500.0 * 1.001
    assert max(map(abs, steps([each.velocity for each in setpoints]))) <= 1_500.0 * DT * 1.001
    assert max(map(abs, slide.rates)) <= 250.0 * 1.1
    late = {number + after for number in missed for after in (0, -1)}  # a late period is no single one
    felt = [abs(step) / DT for number, step in enumerate(steps(slide.rates)) if number + 1 not in late]
    # Missed periods hold the command, inertia term included: the speed goes beyond the setpoint's by acceleration times
    # lag at most. With that lag it comes back, which adds the acceleration once more.
    assert max(felt) <= 2 * 1_500.0


@budget(10, 25)
@given(missed=MISSED)
def test_a_stepper_arrives_whatever_is_missed(missed: dict[int, int]) -> None:
    slide = Late(missed)
    setpoints = run(stepper(), slide, lambda m: m.x.move_to(17.0))
    assert slide.position == pytest.approx(17.0, abs=0.06)
    for step, after in zip(steps([each.velocity for each in setpoints]), setpoints[1:], strict=True):
        assert abs(step) <= 200.0 * DT * 1.001 or abs(after.velocity) <= 200.0 * DT  # a stop, never a start


def test_a_stepper_that_stood_still_in_missed_periods_starts_with_a_ramp() -> None:
    setpoints = run(stepper(), Late({300: 20}), lambda m: m.x.move_to(17.0))
    speeds = [each.velocity for each in setpoints]
    stopped = next(number for number, step in enumerate(steps(speeds), 1) if step < -200.0 * DT * 1.001)
    assert speeds[stopped - 1] == pytest.approx(15.0)
    assert speeds[stopped] <= 200.0 * DT


@pytest.mark.parametrize("every", [1, 2])
def test_a_stepper_that_is_always_late_arrives(every: int) -> None:
    slide = Late(dict.fromkeys(range(1, 100_000, every), 20))
    run(stepper(), slide, lambda m: m.x.move_to(17.0))
    assert slide.position == pytest.approx(17.0, abs=0.06)


def test_a_stepper_that_was_late_by_less_than_a_step_goes_on() -> None:
    usual = run(stepper(), Late({}), lambda m: m.x.move_to(17.0))
    assert run(stepper(), Late({300: 2}), lambda m: m.x.move_to(17.0)) == usual


LAGGING: dict[str, Any] = {"gain": 0.4, "integral_time": inf, "feed_forward": 0.0, "following_error": 50.0}
"""A servo that still moves when its setpoint has arrived."""


@pytest.mark.parametrize("at", [210, 220, 240, 260])
def test_an_axis_that_runs_past_the_end_of_its_motion_in_missed_periods_has_no_step_in_its_command(at: int) -> None:
    slide = Late({at: 100})
    run(servo(**LAGGING), slide, lambda m: m.x.move_to(30.0))
    assert slide.position == pytest.approx(30.0, abs=0.06)
    felt = [abs(step) for number, step in enumerate(steps(slide.rates), 2) if number != at]
    assert max(felt) <= 2_000.0 * DT


def test_missed_periods_are_no_time_in_which_an_axis_settles() -> None:
    slide = Late(dict.fromkeys(range(262, 400, 4), 60), still=True)
    run(servo(**LAGGING, settling_time=0.4), slide, lambda m: m.x.move_to(30.0))
    assert slide.position == pytest.approx(30.0, abs=0.06)


def test_an_axis_at_rest_stays_where_it_is_when_periods_are_missed() -> None:
    async def work(m: Rail) -> None:
        await m.x.move_to(20.0)
        before = m.x.setpoint
        await wait(1.0)
        assert m.x.setpoint == before

    run(servo(), Late(dict.fromkeys(range(600, 700, 10), 50)), work)


def test_a_stalled_axis_is_found_although_every_other_period_is_missed() -> None:
    slide = Late(dict.fromkeys(range(1, 10_000), 2))

    async def work(m: Rail) -> None:
        slide.stuck = True
        await m.x.move_to(90.0)

    with pytest.raises(AxisError, match="does not follow"):
        run(servo(), slide, work)
