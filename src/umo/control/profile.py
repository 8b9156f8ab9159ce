"""Jerk-limited motion profiles, time-optimal from any starting state. A profile to a position is computed by ruckig, a
profile to a velocity by a formula."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import copysign, frexp, inf, isfinite, isnan, sqrt
from types import ModuleType
from typing import Any, NamedTuple

from umo.control.checks import check_numbers
from umo.errors import RangeError

ACCELERATION_SHARES = (1.0, 1.0 - 1e-9, 1.0 - 1e-6)
"""The shares of the largest acceleration that are tried one after another. For about one in ten motions that reach the
largest acceleration only for an instant, ruckig finds no profile with the whole acceleration."""


class Setpoint(NamedTuple):
    """Position, velocity and acceleration of the setpoint, in units, units/s and units/s^2."""

    position: float
    velocity: float
    acceleration: float


class Segment(NamedTuple):
    """A part of a motion with constant jerk, from `start` (s since the motion began) to the start of the next segment.
    Position, velocity and acceleration are those at the start of the segment."""

    start: float
    position: float
    velocity: float
    acceleration: float
    jerk: float


MOST_SEGMENTS = 10
"""Largest number of segments of a motion: two that bring the motion within the limits, seven to the target, and the
last one."""
_NONE = Segment(inf, 0.0, 0.0, 0.0, 0.0)
"""The placeholder for a segment that a motion does not have."""


def _within(segment: Segment, time: float) -> tuple[float, float, float]:
    """Return position, velocity and acceleration `time` s after the start of a segment."""
    _, p, v, a, j = segment
    return p + time * (v + time * (a / 2.0 + time * j / 6.0)), v + time * (a + time * j / 2.0), a + time * j


def _after(segment: Segment, time: float, acceleration: float, jerk: float) -> Segment:
    """Return the segment that begins `time` s after the start of the given one, with this acceleration and jerk."""
    position, velocity, _ = _within(segment, time)
    return Segment(segment.start + time, position, velocity, acceleration, jerk)


def _padded(segments: list[Segment]) -> list[Segment]:
    return [*segments, *[_NONE] * (MOST_SEGMENTS - len(segments))]


@dataclass
class Profile:
    """A setpoint profile to a target position within the given limits, advanced by one period per call.

    A motion consists of segments of constant jerk; the last one does not end. A motion to a position is planned by
    ruckig. A motion to a velocity, such as to standstill, is computed by a formula, so that a controller can brake
    without ruckig."""

    velocity: float
    """Largest speed, units per s."""
    acceleration: float
    """Largest acceleration, units per s squared."""
    jerk: float
    """Largest jerk, units per s cubed."""
    setpoint: Setpoint = field(default=Setpoint(0.0, 0.0, 0.0), init=False)
    segments: list[Segment] = field(default_factory=lambda: _padded([Segment(0.0, *[0.0] * 4)]), init=False, repr=False)
    """The segments of the motion in progress. Their number is always `MOST_SEGMENTS`. A segment that starts at infinity
    marks the end of the segments."""
    origin: float = field(default=0.0, init=False, repr=False)
    """The offset that is added to the positions of the segments."""
    elapsed: float = field(default=0.0, init=False)
    """Time since the motion began, s."""
    duration: float = field(default=0.0, init=False)
    """Time in s from the beginning of the motion until the target, or the velocity, is reached."""
    _planner: Any = field(default_factory=lambda: _ruckig().Ruckig(1), init=False, repr=False)

    def __post_init__(self) -> None:
        self.check_settings()

    def check_settings(self) -> None:
        """Check the settings. Raises DeclarationError unless the limits are above 0."""
        check_numbers(self, above_0=("velocity", "acceleration", "jerk"))

    def hold(self, position: float, velocity: float = 0.0) -> None:
        """Set the position and velocity from which the profile continues. Raises RangeError if one of the two is not
        finite."""
        if not (isfinite(position) and isfinite(velocity)):
            raise RangeError(f"position {position!r} and velocity {velocity!r} per s must be finite")
        self.setpoint = Setpoint(position, velocity, 0.0)
        self.segments[0], self.segments[1] = Segment(0.0, position, velocity, 0.0, 0.0), _NONE
        self.elapsed = self.origin = self.duration = 0.0

    def shift(self, distance: float) -> None:
        """Move the origin of the positions: the setpoint changes by this distance, and the motion continues. Raises
        RangeError if the distance is not finite."""
        if not isfinite(distance):
            raise RangeError(f"the distance of a shift must be finite, not {distance!r}")
        position, velocity, acceleration = self.setpoint
        self.setpoint = Setpoint(position + distance, velocity, acceleration)
        self.origin += distance

    def to(self, target: float, *, velocity: float = inf, duration: float = 0.0) -> float:
        """Plan a profile from the current setpoint to standstill at the target. Returns its duration in s.

        `velocity` lowers the largest speed for this profile. `duration` is the least time in s that the profile takes:
        if several axes get the duration of the slowest axis, they arrive together. Raises RangeError if the target is
        not finite, a limit is not positive, or the duration is negative or not finite.
        """
        if not velocity > 0.0:
            raise RangeError(f"the velocity of a profile to {target!r} must be above 0, not {velocity!r}")
        if not 0.0 <= duration < inf:
            raise RangeError(
                f"the duration of a profile to {target!r} must be finite and not negative, not {duration!r}"
            )
        plan, scale = self._plan()
        plan.target_position = [target * scale]
        plan.max_velocity = [min(velocity, self.velocity) * scale]
        if duration:
            plan.minimum_duration = duration
        return self._follow(plan, scale, f"to {target!r}")

    def at(self, velocity: float) -> float:
        """Change from the current setpoint to a constant velocity, at most the largest speed; 0 means standstill. The
        setpoint then continues at this velocity. Returns the time in s until this velocity is reached. Raises
        RangeError for NaN."""
        jerk, limit = self.jerk, self.acceleration
        final = min(max(velocity, -self.velocity), self.velocity)
        limited = self.velocity > 0.0 and limit > 0.0 and jerk > 0.0 and isfinite(min(limit, jerk))
        if not limited or isnan(velocity) or not isfinite(final):
            raise RangeError(f"a velocity of {velocity!r} per s cannot be reached within the limits of {self!r}")
        position, v, a = self.setpoint
        sign = copysign(1.0, final - v - a * abs(a) / (2.0 * jerk))  # of what is missing once there is no acceleration
        begun, change = sign * a, sign * (final - v)
        peak = min(limit, sqrt(max(0.0, jerk * change + begun * begun / 2.0)))
        rise, fall, hold = abs(peak - begun) / jerk, peak / jerk, 0.0
        if peak == limit:
            hold = max(0.0, (change - rise * (begun + peak) / 2.0 - fall * peak / 2.0) / peak)
        first = Segment(0.0, position, v, a, sign * copysign(jerk, peak - begun) if rise else 0.0)
        second = _after(first, rise, sign * peak, 0.0)
        third = _after(second, hold, sign * peak, -sign * jerk if fall else 0.0)
        last = _after(third, fall, 0.0, 0.0)
        self.segments[0], self.segments[1], self.segments[2] = first, second, third
        self.segments[3], self.segments[4] = Segment(last.start, last.position, final, 0.0, 0.0), _NONE
        self.elapsed, self.origin, self.duration = 0.0, 0.0, last.start
        return self.duration

    def _plan(self) -> tuple[Any, float]:
        """Return the current setpoint and the limits in the form for ruckig, and the scale of their lengths."""
        if not self.velocity > 0.0:
            raise RangeError(f"a profile cannot be planned within the limits of {self!r}")
        plan = _ruckig().InputParameter(1)
        scale = 2.0 ** -frexp(self.velocity)[1]
        plan.current_position = [self.setpoint.position * scale]
        plan.current_velocity = [self.setpoint.velocity * scale]
        plan.current_acceleration = [self.setpoint.acceleration * scale]
        plan.max_velocity = [self.velocity * scale]
        plan.max_acceleration = [self.acceleration * scale]
        plan.max_jerk = [self.jerk * scale]
        return plan, scale

    def _follow(self, plan: Any, scale: float, what: str) -> float:
        """Compute the profile of a plan, begin it, and return its duration in s. Raises RangeError if there is no such
        profile; then the present motion continues."""
        limit = plan.max_acceleration[0]
        trajectory = _ruckig().Trajectory(1)
        found = ""
        for share in ACCELERATION_SHARES:
            plan.max_acceleration = [limit * share]
            found = self._calculate(plan, trajectory)
            if not found:
                break
        else:
            raise RangeError(f"a profile {what} cannot be planned within the limits of {self!r}: {found}")
        self.segments = _padded(_segments(trajectory, scale))
        self.elapsed, self.origin, self.duration = 0.0, 0.0, float(trajectory.duration)
        return self.duration

    def _calculate(self, plan: Any, trajectory: Any) -> str:
        """Calculate a trajectory. Return the reason why there is none, or "" if there is one."""
        ruckig = _ruckig()
        try:
            result = self._planner.calculate(plan, trajectory)
        except (ruckig.RuckigError, ValueError) as error:  # ValueError: a result that its enum does not know
            return str(error).strip().partition(" input:")[0]
        return "" if result in (ruckig.Result.Working, ruckig.Result.Finished) else str(result.name)

    @property
    def done(self) -> bool:
        """True if the target, or the velocity, is reached."""
        return self.elapsed >= self.duration

    @property
    def stops(self) -> bool:
        """True if the setpoint stands still, or comes to a standstill by itself."""
        last = self.segments[0]
        for each in self.segments:
            if each.start == inf:
                break
            last = each
        return not last.velocity

    def step(self, dt: float) -> Setpoint:
        """Advance the profile by `dt` s and return the setpoint. After the end of the profile the setpoint stays at the
        target, or continues at the velocity. `dt` must not be negative. Raises RangeError if `dt` is not finite."""
        before = self.elapsed
        elapsed = before + dt
        if not isfinite(elapsed):
            raise RangeError(f"the time of a step must be finite, not {dt!r} s")
        self.elapsed = elapsed
        if before > self.duration and not self.setpoint.velocity:
            return self.setpoint  # it stands
        at = self.segments[0]
        for each in self.segments:
            if elapsed < each.start:
                break
            at = each
        position, velocity, acceleration = _within(at, elapsed - at.start)
        self.setpoint = setpoint = Setpoint(position + self.origin, velocity, acceleration)
        return setpoint


def _segments(trajectory: Any, scale: float) -> list[Segment]:
    """Return the segments of a trajectory of ruckig that ends at standstill, with lengths times `scale`."""
    profile = trajectory.profiles[0][0]
    found, start = [], 0.0
    for part in (profile.brake, profile):
        for time, jerk, *state in zip(part.t, part.j, part.p, part.v, part.a, strict=False):
            if time > 0.0:
                found.append(Segment(start, *(each / scale for each in (*state, jerk))))
                start += time
    (position,), *_ = trajectory.at_time(trajectory.duration)
    return [*found, Segment(float(trajectory.duration), position / scale, 0.0, 0.0, 0.0)]


def _ruckig() -> ModuleType:
    """Return ruckig. It is imported with the first profile and not with umo, because the import takes 0.2 s."""
    import ruckig

    return ruckig  # type: ignore[no-any-return]
