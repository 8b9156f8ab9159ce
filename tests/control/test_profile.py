"""Jerk-limited profiles."""

from __future__ import annotations

import itertools
from itertools import pairwise
from math import inf, nan

import pytest
import ruckig
from hypothesis import given, reject
from hypothesis import strategies as st

from umo.control import Profile
from umo.control.profile import MOST_SEGMENTS, Setpoint
from umo.errors import DeclarationError, RangeError


def limits() -> Profile:
    return Profile(velocity=100.0, acceleration=1_000.0, jerk=20_000.0)


positions = st.floats(-1e3, 1e3)


@given(start=positions, target=positions, dt=st.sampled_from([1e-3, 2.5e-3, 1e-2]))
def test_a_path_ends_at_its_target_and_keeps_every_limit(start: float, target: float, dt: float) -> None:
    profile = limits()
    profile.hold(start)
    duration = profile.to(target)
    before, periods = profile.setpoint, 0
    while not profile.done:
        now = profile.step(dt)
        periods += 1
        assert abs(now.velocity) <= 100.0 + 1e-6
        assert abs(now.acceleration) <= 1_000.0 + 1e-6
        assert abs(now.acceleration - before.acceleration) <= 20_000.0 * dt + 1e-6
        before = now
    assert profile.setpoint.position == pytest.approx(target, abs=1e-6)
    assert profile.setpoint.velocity == pytest.approx(0.0, abs=1e-6)
    assert (periods - 1) * dt <= duration + 1e-9


@given(
    size=st.sampled_from([1e-6, 1e-3, 1.0, 1e3, 1e5, 1e7]),
    share=st.floats(0.01, 0.99),
    target=st.floats(-1.0, 1.0),
    velocity=st.floats(-1.0, 1.0),
)
def test_a_motion_is_planned_anew_at_any_moment_in_units_of_any_size(
    size: float, share: float, target: float, velocity: float
) -> None:
    """The planner has absolute tolerances: in um, one in ten such plans was refused."""
    profile = Profile(velocity=size, acceleration=10.0 * size, jerk=200.0 * size)
    duration = profile.to(size)
    middle = profile.step(round(share * duration, 3))
    profile.at(velocity * size)
    profile.setpoint = middle
    profile.to(target * size)
    profile.setpoint = middle
    stop = profile.at(0.0)
    assert profile.step(stop + 1.0).velocity == 0.0
    assert abs(profile.setpoint.position - middle.position) <= abs(middle.velocity) * stop + 1e-9 * size + size


def test_at_the_end_the_setpoint_stays_at_the_target() -> None:
    profile = limits()
    profile.to(1.0)
    profile.step(10.0)
    assert profile.done
    assert profile.step(1.0).position == pytest.approx(1.0)


def test_hold_ends_the_motion_under_way() -> None:
    profile = limits()
    profile.to(100.0)
    profile.step(0.5)
    profile.hold(7.0)
    assert profile.done
    assert profile.step(0.1) == (7.0, 0.0, 0.0)


def test_a_new_target_is_planned_from_the_motion_under_way() -> None:
    profile = limits()
    profile.to(100.0)
    moving = profile.step(0.5)
    assert moving.velocity > 50.0
    profile.to(0.0)
    after = profile.step(1e-3)
    assert after.position == pytest.approx(moving.position + 0.1, abs=0.05)
    assert after.velocity == pytest.approx(moving.velocity, abs=2.0)


def test_a_path_may_be_slower_but_not_faster_than_its_limit() -> None:
    profile = limits()
    assert profile.to(100.0, velocity=10.0) > 9.0
    assert profile.to(100.0, velocity=1e9) == pytest.approx(limits().to(100.0))


def test_a_missed_period_only_makes_the_step_longer() -> None:
    one, two = limits(), limits()
    one.to(50.0)
    two.to(50.0)
    one.step(0.1)
    one.step(0.2)
    assert one.setpoint == two.step(0.1 + 0.2)


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        ({"target": nan}, "a profile to nan cannot be planned"),
        ({"target": inf}, "a profile to inf cannot be planned"),
        ({"target": 1e300}, "a profile to 1e\\+300 cannot be planned"),
        *(
            ({"target": 5.0, "velocity": v}, "the velocity of a profile to 5.0 must be above 0, not")
            for v in (0.0, -1.0, nan)
        ),
        *(
            ({"target": 5.0, "duration": s}, "the duration of a profile to 5.0 must be finite and not negative")
            for s in (-1.0, nan, inf)
        ),
        ({"target": 5.0, "duration": 1e300}, "a profile to 5.0 cannot be planned"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_line_and_the_motion_goes_on(
    plan: dict[str, float], said: str
) -> None:
    """Also after a limit has been tuned on the way."""
    profile, untouched = limits(), limits()
    for each in (profile, untouched):
        each.to(10.0)
        each.step(0.05)
        each.velocity = 10.0
    with pytest.raises(RangeError, match=said) as caught:
        profile.to(**plan)
    assert "\n" not in str(caught.value)
    for _ in range(3):
        assert profile.step(0.01) == untouched.step(0.01)
    assert profile.to(20.0) == untouched.to(20.0)


@pytest.mark.parametrize("dt", [float("nan"), float("inf")])
def test_a_step_that_is_not_finite_is_refused_and_the_motion_goes_on(dt: float) -> None:
    profile = limits()
    profile.to(5.0)
    with pytest.raises(RangeError, match="must be finite"):
        profile.step(dt)
    assert not profile.done
    assert profile.step(10.0).position == pytest.approx(5.0)
    assert profile.done
    profile.hold(0.0, velocity=10.0)
    with pytest.raises(RangeError, match="must be finite"):
        profile.step(dt)
    assert profile.step(1.0).position == pytest.approx(10.0)


def test_a_limit_that_is_not_positive_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r"Profile\.velocity must be above 0, not 0.0"):
        Profile(velocity=0.0, acceleration=1.0, jerk=1.0)
    profile = limits()
    profile.jerk = 0.0
    with pytest.raises(RangeError):
        profile.to(1.0)


def test_a_velocity_is_reached_and_kept_within_the_limits() -> None:
    profile = limits()
    duration = profile.at(50.0)
    speeds = [profile.step(1e-3).velocity for _ in range(round(duration * 1e3) + 1)]
    assert max(b - a for a, b in pairwise(speeds)) <= 1_000.0 * 1e-3 + 1e-9
    assert profile.done
    before = profile.setpoint.position
    assert profile.step(2.0) == pytest.approx((before + 100.0, 50.0, 0.0))
    assert profile.at(1e6) > 0
    assert profile.step(10.0).velocity == 100.0


def test_a_halt_comes_to_standstill_and_a_new_target_is_reached_from_there() -> None:
    profile = limits()
    profile.at(-80.0)
    profile.step(1.0)
    profile.at(0.0)
    stood = profile.step(1.0).position
    assert profile.step(1.0) == pytest.approx((stood, 0.0, 0.0))
    profile.to(5.0)
    assert profile.step(10.0).position == pytest.approx(5.0)


@given(distance=positions, dt=st.sampled_from([1e-3, 1e-2]))
def test_a_shift_of_the_origin_moves_the_rest_of_the_motion(distance: float, dt: float) -> None:
    one, other = limits(), limits()
    for profile in (one, other):
        profile.to(100.0)
        profile.step(0.3)
    other.shift(distance)
    while not one.done:
        here, there = one.step(dt), other.step(dt)
        assert there.position == pytest.approx(here.position + distance, abs=1e-9)
        assert there[1:] == here[1:]


@pytest.mark.parametrize("start", [0.0, 2.5, 40.0, -7.25])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_motion_over_just_the_distance_in_which_the_largest_acceleration_is_reached_is_planned(
    start: float, sign: float
) -> None:
    """2 a**3 / j**2, of which ruckig finds one in ten not."""
    for acceleration, jerk in itertools.product((1.0, 10.0, 200.0, 1_500.0), (10.0, 25.0, 33.3)):
        profile = Profile(velocity=1e3, acceleration=acceleration, jerk=acceleration * jerk)
        profile.hold(start)
        target = start + sign * 2 * acceleration / jerk**2
        profile.to(target)
        while not profile.done:
            profile.step(0.001)
        assert profile.setpoint.position == pytest.approx(target)


@given(
    start=st.tuples(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
    target=st.floats(-1.0, 1.0),
    cruises=st.booleans(),
    shares=st.lists(st.floats(0.0, 1.2), min_size=5, max_size=5),
)
def test_the_segments_give_the_motion_that_the_planner_has_found(
    start: tuple[float, float, float], target: float, cruises: bool, shares: list[float]
) -> None:
    """Also from beyond the limits of velocity and acceleration."""
    profile = Profile(velocity=1.0, acceleration=1.0, jerk=8.0)
    profile.setpoint = Setpoint(*start)
    plan = ruckig.InputParameter(1)
    plan.current_position, plan.current_velocity, plan.current_acceleration = ([each] for each in start)
    plan.max_velocity, plan.max_acceleration, plan.max_jerk = [1.0], [1.0], [8.0]
    if cruises:
        plan.control_interface, plan.target_velocity = ruckig.ControlInterface.Velocity, [target]
    else:
        plan.target_position = [target]
    trajectory = ruckig.Trajectory(1)
    try:
        (profile.at if cruises else profile.to)(target)
        assert ruckig.Ruckig(1).calculate(plan, trajectory) in (ruckig.Result.Working, ruckig.Result.Finished)
    except (RangeError, ruckig.RuckigError):  # one in some thousands is planned with a little less acceleration
        reject()
    assert profile.duration == pytest.approx(trajectory.duration, abs=1e-9)
    before = 0.0
    for time in sorted(share * trajectory.duration for share in shares):
        found, expected = profile.step(time - before), [each[0] for each in trajectory.at_time(time)]
        assert found[:2] == pytest.approx(expected[:2], abs=1e-9)
        before = time
    assert len(profile.segments) == MOST_SEGMENTS


@given(
    start=st.tuples(positions, st.floats(-2e2, 2e2), st.floats(-2e3, 2e3)),
    limits=st.tuples(st.floats(1.0, 1e4), st.floats(1.0, 1e6)),
    target=st.sampled_from([0.0, 0.0, 30.0, -100.0]),
)
def test_braking_takes_the_time_and_the_distance_that_the_planner_finds(
    start: tuple[float, float, float], limits: tuple[float, float], target: float
) -> None:
    """Whatever the velocity and acceleration are, also beyond the limits."""
    acceleration, jerk = limits
    profile = Profile(velocity=100.0, acceleration=acceleration, jerk=jerk)
    profile.setpoint = Setpoint(*start)
    plan, trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
    plan.control_interface = ruckig.ControlInterface.Velocity
    plan.current_position, plan.current_velocity, plan.current_acceleration = ([each] for each in start)
    plan.max_velocity, plan.max_acceleration, plan.max_jerk = [100.0], [acceleration], [jerk]
    plan.target_velocity = [target]
    if ruckig.Ruckig(1).calculate(plan, trajectory) not in (ruckig.Result.Working, ruckig.Result.Finished):
        reject()
    (distance,), *_ = trajectory.at_time(trajectory.duration)
    assert profile.at(target) == pytest.approx(trajectory.duration, rel=1e-6, abs=1e-6)
    end = profile.segments[3]
    assert end.position - start[0] == pytest.approx(distance - start[0], rel=1e-6, abs=1e-6)
    assert (end.velocity, end.acceleration) == (target, 0.0)
    late = profile.duration + 1.0
    assert profile.step(late) == pytest.approx((end.position + target * (late - end.start), target, 0.0), abs=1e-6)


@pytest.mark.parametrize(("acceleration", "jerk"), [(inf, 20.0), (10.0, inf)])
def test_a_velocity_is_reached_with_one_limit_that_is_infinite(acceleration: float, jerk: float) -> None:
    profile = Profile(velocity=100.0, acceleration=acceleration, jerk=jerk)
    assert profile.at(5.0) == pytest.approx(1.0 if acceleration == inf else 0.5)
    assert profile.step(0.25).velocity == pytest.approx(0.625 if acceleration == inf else 2.5)
    assert profile.step(2.0).velocity == 5.0


@pytest.mark.parametrize("limit", ["velocity", "acceleration", "jerk"])
def test_a_velocity_is_refused_where_a_limit_is_not_positive_and_the_motion_goes_on(limit: str) -> None:
    profile, untouched = limits(), limits()
    for each in (profile, untouched):
        each.to(10.0)
    setattr(profile, limit, 0.0)
    for velocity in (1.0, nan):
        with pytest.raises(RangeError, match="cannot be reached within the limits"):
            profile.at(velocity)
    assert profile.step(0.05) == untouched.step(0.05)
