"""PID on plain numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo import Number
from umo.control import PID, VectorPID

LIMITS = {"low": 0.0, "high": 10.0}


class Tank:
    """Its level in mm rises by 3 mm/s at full inflow (10 V) and falls with its outflow."""

    def __init__(self, level: float = 0.0, outflow: float = 0.6) -> None:
        self.level, self.outflow = level, outflow

    def pass_(self, volts: float, dt: float) -> None:
        self.level = max(0.0, self.level + (0.3 * 10 * volts / 10 * 10 - self.outflow) * dt)


def fill(output: object, goal: float, *, seconds: float = 200.0, start: float = 0.0, dt: float = 0.1) -> list[float]:
    """The level, a number a period, under a law `output(level, dt)`."""
    tank, path = Tank(start), []
    for _ in range(round(seconds / dt)):
        tank.pass_(output(tank.level, dt), dt)  # type: ignore[operator]
        path.append(tank.level)
    return path


def reached(path: list[float], goal: float, within: float, dt: float = 0.1) -> float:
    """s until the level is within the tolerance for good."""
    outside = [i for i, level in enumerate(path) if abs(level - goal) > within]
    return (outside[-1] + 1) * dt if outside else 0.0


def conditional(gain: float, integral_time: float, goal: float) -> object:
    """Conditional integration by hand, as in a textbook."""
    integral = 0.0

    def output(level: float, dt: float) -> float:
        nonlocal integral
        error = goal - level
        wanted = gain * error + integral
        limited = min(max(wanted, 0.0), 10.0)
        if limited == wanted or (wanted > 10.0) == (error < 0.0):
            integral += gain * error * dt / integral_time
        return limited

    return output


@pytest.mark.parametrize("integral_time", [10.0, 20.0, 60.0])
@pytest.mark.parametrize(("start", "goal"), [(0.0, 300.0), (500.0, 300.0)])
def test_a_level_is_reached_as_soon_as_with_conditional_integration(
    integral_time: float, start: float, goal: float
) -> None:
    """Two stacked anti-windups led the integral down, 88 s in place of 32 s."""
    law = PID(gain=0.3, integral_time=integral_time)
    path = fill(lambda level, dt: law.step(goal, level, dt, **LIMITS), goal, start=start, seconds=900)
    by_client = fill(conditional(0.3, integral_time, goal), goal, start=start, seconds=900)
    assert 0 < reached(path, goal, 2.0) <= 1.1 * reached(by_client, goal, 2.0)


@pytest.mark.parametrize(("goal", "limit"), [(1e6, 10.0), (-1e6, 0.0)])
def test_nothing_winds_up_at_either_end(goal: float, limit: float) -> None:
    law = PID(gain=0.3, integral_time=1.0)
    for _ in range(1000):
        assert law.step(goal, 0.0, 0.1, **LIMITS) == limit
    assert law.limited
    assert 0.0 <= law.integral <= 10.0
    assert law.step(5.0, 0.0, 0.1, **LIMITS) == pytest.approx(min(max(1.5 + law.integral, 0.0), 10.0), abs=0.2)
    assert not law.limited


def test_the_proportional_part_is_gain_times_error() -> None:
    law = PID(gain=2.0)
    assert law.step(1.5, 1.0, 0.1) == 1.0
    assert (law.error, law.integral, law.limited) == (0.5, 0.0, False)


def test_a_negative_gain_acts_the_other_way_and_winds_up_as_little() -> None:
    law, mirrored = PID(gain=-0.3, integral_time=5.0), PID(gain=0.3, integral_time=5.0)
    for i in range(200):
        measured = 40.0 * math.sin(i / 10)
        assert law.step(0.0, -measured, 0.1, low=-10.0, high=0.0) == pytest.approx(
            -mirrored.step(0.0, -measured, 0.1, **LIMITS)
        )


@given(st.floats(-10, 10), st.floats(-100, 100), st.floats(-100, 100), st.floats(-5, 5))
def test_a_take_over_goes_on_from_the_output_that_stands(
    output: float, setpoint: float, measurement: float, feed_forward: float
) -> None:
    law = PID(gain=0.5, integral_time=3.0, derivative_time=0.2, filter_time=0.1)
    law.step(7.0, 3.0, 0.1)
    law.take_over(output, setpoint, measurement, feed_forward)
    assert law.step(setpoint, measurement, 0.0, feed_forward=feed_forward) == pytest.approx(output)


def test_a_changed_gain_makes_no_step_at_a_steady_state() -> None:
    law = PID(gain=1.0, integral_time=1.0)
    for _ in range(10):
        law.step(1.0, 0.5, 0.1)
    before = law.step(1.0, 1.0, 0.1)
    law.gain = 3.0
    assert law.step(1.0, 1.0, 0.1) == pytest.approx(before)


def test_reset_forgets_the_past() -> None:
    law = PID(gain=1.0, integral_time=0.1, derivative_time=0.1, filter_time=0.1)
    for measured in (0.0, 1.0, 3.0):
        law.step(5.0, measured, 0.1, high=1.0)
    law.reset()
    assert law == PID(gain=1.0, integral_time=0.1, derivative_time=0.1, filter_time=0.1)
    assert law.step(1.0, 1.0, 0.1) == 0.0


def test_in_no_time_integral_and_derivative_do_not_contribute() -> None:
    law = PID(gain=2.0, integral_time=0.1, derivative_time=1.0)
    assert [law.step(2.0, measured, 0.0) for measured in (0.0, 1.0)] == [4.0, 2.0]


NUMBERS = st.floats(-100, 100).map(lambda number: round(number, 3))


@given(
    st.lists(st.tuples(NUMBERS, NUMBERS, st.sampled_from([0.0, 0.01, 0.1])), min_size=1, max_size=20),
    st.lists(
        st.tuples(st.floats(-2, 2), st.sampled_from([0.5, 3.0, math.inf]), st.sampled_from([0.0, 0.2])),
        min_size=1,
        max_size=4,
    ),
)
def test_many_at_once_do_what_each_does_alone(
    steps: list[tuple[float, float, float]], laws: list[tuple[float, float, float]]
) -> None:
    gain, integral_time, derivative_time = (np.array(column) for column in zip(*laws, strict=True))
    many = VectorPID(gain=gain, integral_time=integral_time, derivative_time=derivative_time, filter_time=0.05)
    each = [PID(gain=k, integral_time=ti, derivative_time=td, filter_time=0.05) for k, ti, td in laws]
    offsets = np.arange(len(laws)) * 7.0
    for setpoint, measured, dt in steps:
        together = many.step(setpoint, measured + offsets, dt, feed_forward=0.5, low=-20.0, high=10.0)
        alone = [
            law.step(setpoint, measured + offset, dt, feed_forward=0.5, low=-20.0, high=10.0)
            for law, offset in zip(each, offsets.tolist(), strict=True)
        ]
        assert together.tolist() == pytest.approx(alone, abs=1e-9)
        assert np.broadcast_to(many.integral, len(laws)).tolist() == pytest.approx(
            [law.integral for law in each], abs=1e-9
        )
    many.reset()
    assert many.step(1.0, np.ones(len(laws)), 0.1).tolist() == [0.0] * len(laws)


def test_a_cascade_of_position_over_velocity_stands_still_at_its_goal() -> None:
    position, velocity = PID(gain=4.0), PID(gain=40.0, integral_time=0.2)
    x = v = 0.0
    for _ in range(6000):
        wanted = position.step(10.0, x, 1e-3, low=-5.0, high=5.0)
        v += (velocity.step(wanted, v, 1e-3, low=-20.0, high=20.0) - 0.5) * 1e-3
        x += v * 1e-3
    assert x == pytest.approx(10.0, abs=0.01)
    assert v == pytest.approx(0.0, abs=0.01)


def test_the_largest_error_is_the_largest_magnitude() -> None:
    law = VectorPID(gain=1.0)
    assert law.largest_error == 0.0
    law.step(1.0, np.array([0.5, 4.0, 1.0]), 0.1)
    assert law.largest_error == 3.0
    assert law.numbers["largest_error"] == Number(shown=True)


def test_a_derivative_that_is_switched_on_again_does_not_see_what_happened_meanwhile() -> None:
    law = VectorPID(gain=-1.0, derivative_time=1.0)
    for measured, derivative_time in ((0.0, 1.0), (5.0, 0.0), (10.0, 0.0)):
        law.derivative_time = derivative_time
        law.step(0.0, np.array([measured]), 0.01)
    law.derivative_time = 1.0
    assert law.step(0.0, np.array([10.0]), 0.01).tolist() == [10.0]
    assert law.step(0.0, np.array([10.1]), 0.01).tolist() == pytest.approx([20.1])


def test_a_time_that_is_an_array_is_no_number_of_the_machine() -> None:
    law = VectorPID(gain=1.0, integral_time=np.ones(2), derivative_time=0.5)
    assert law.numbers.keys() == {"largest_error", "derivative_time", "filter_time"}
