"""Jerk-limited motion profiles, through ruckig (time-optimal, any starting state)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import frexp, inf, isfinite
from types import ModuleType
from typing import Any, NamedTuple

from umo.control.checks import check_numbers
from umo.errors import RangeError

ACCELERATION_SHARES = (1.0, 1.0 - 1e-9, 1.0 - 1e-6)
"""Shares of the largest acceleration that are tried one after another: ruckig finds no profile for about one in ten
motions over just the distance in which the largest acceleration is reached for a moment."""


class Setpoint(NamedTuple):
    """Position, velocity and acceleration of the setpoint, in units, units/s and units/s^2."""

    position: float
    velocity: float
    acceleration: float


@dataclass
class Profile:
    """A setpoint profile to a target position within these limits, advanced by one period per call."""

    velocity: float
    """Largest speed, units per s."""
    acceleration: float
    """Largest acceleration, units per s squared."""
    jerk: float
    """Largest jerk, units per s cubed."""
    setpoint: Setpoint = field(default=Setpoint(0.0, 0.0, 0.0), init=False)
    _planner: Any = field(default_factory=lambda: _ruckig().Ruckig(1), init=False, repr=False)
    _trajectory: Any = field(default_factory=lambda: _ruckig().Trajectory(1), init=False, repr=False)
    _next: Any = field(default_factory=lambda: _ruckig().Trajectory(1), init=False, repr=False)
    """Place in which the next one is calculated: ruckig leaves wrong numbers in one that it does not find."""
    _elapsed: float = field(default=0.0, init=False)
    _duration: float = field(default=0.0, init=False)
    _origin: float = field(default=0.0, init=False)
    _final: float = field(default=0.0, init=False)
    _scale: float = field(default=1.0, init=False, repr=False)
    """The factor of the lengths that ruckig is given. Its tolerances are absolute: with speeds of 1e5 it finds no
    profile for one in ten motions that are planned anew on the way. A power of two changes no digit."""

    def __post_init__(self) -> None:
        self.check_settings()

    def check_settings(self) -> None:
        """DeclarationError unless the limits are above 0."""
        check_numbers(self, above_0=("velocity", "acceleration", "jerk"))

    def hold(self, position: float, velocity: float = 0.0) -> None:
        """Set the position and velocity from which the profile goes on. RangeError if one is not finite."""
        if not (isfinite(position) and isfinite(velocity)):
            raise RangeError(f"no profile from {position!r} at {velocity!r} per s: both must be finite")
        self.setpoint = Setpoint(position, velocity, 0.0)
        self._duration = 0.0

    def shift(self, distance: float) -> None:
        """The origin of the positions has moved: the setpoint changes by this distance, the motion goes on. RangeError
        if it is not finite."""
        if not isfinite(distance):
            raise RangeError(f"a profile cannot be shifted by {distance!r}")
        position, velocity, acceleration = self.setpoint
        self.setpoint = Setpoint(position + distance, velocity, acceleration)
        self._origin += distance

    def to(self, target: float, *, velocity: float = inf, duration: float = 0.0) -> float:
        """Plan a profile from the current setpoint to standstill at the target. Returns its duration in s.

        `velocity` lowers the largest speed for this profile. `duration` is the least time in s that it takes: several
        axes with the duration of the slowest arrive together. RangeError if the target is not finite, a
        limit is not positive, or the duration is negative or not finite.
        """
        if not velocity > 0.0:
            raise RangeError(f"no profile to {target!r}: the velocity must be positive, not {velocity!r}")
        if not 0.0 <= duration < inf:
            raise RangeError(
                f"no profile to {target!r}: the duration must be finite and not negative, not {duration!r}"
            )
        plan, scale = self._plan()
        plan.target_position = [target * scale]
        plan.max_velocity = [min(velocity, self.velocity) * scale]
        if duration:
            plan.minimum_duration = duration
        return self._follow(plan, scale, f"to {target!r}")

    def at(self, velocity: float) -> float:
        """Plan a profile from the current setpoint to a constant velocity, at most the largest speed; 0: to standstill.
        The setpoint moves on at this velocity. Returns the duration in s until it is reached. RangeError for NaN."""
        plan, scale = self._plan()
        plan.control_interface = _ruckig().ControlInterface.Velocity
        plan.target_velocity = [min(max(velocity, -self.velocity), self.velocity) * scale]
        return self._follow(plan, scale, f"at {velocity!r} per s")

    def _plan(self) -> tuple[Any, float]:
        """The current setpoint and the limits for ruckig, and the scale of their lengths."""
        if not self.velocity > 0.0:
            raise RangeError(f"no profile within the limits of {self!r}")
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
        """Begin a plan; its duration in s. If there is no such profile, what is under way goes on."""
        limit = plan.max_acceleration[0]
        found = ""
        for share in ACCELERATION_SHARES:
            plan.max_acceleration = [limit * share]
            found = self._calculate(plan)
            if not found:
                break
        else:
            raise RangeError(f"no profile {what} within the limits of {self!r}: {found}")
        self._duration = float(self._next.duration)
        self._trajectory, self._next = self._next, self._trajectory
        self._elapsed, self._origin, self._scale = 0.0, 0.0, scale
        self._final = plan.target_velocity[0] / scale
        return self._duration

    def _calculate(self, plan: Any) -> str:
        """Calculate the next trajectory; why there is none, "" if there is one."""
        ruckig = _ruckig()
        try:
            result = self._planner.calculate(plan, self._next)
        except (ruckig.RuckigError, ValueError) as error:  # ValueError: a result that its enum does not know
            return str(error).strip().partition(" input:")[0]
        return "" if result in (ruckig.Result.Working, ruckig.Result.Finished) else str(result.name)

    @property
    def done(self) -> bool:
        """Whether the target, or the velocity, is reached."""
        return self._elapsed >= self._duration

    @property
    def stops(self) -> bool:
        """Whether the setpoint stands, or comes to a standstill by itself."""
        return not (self._final if self._duration else self.setpoint.velocity)

    def step(self, dt: float) -> Setpoint:
        """Advance the profile by `dt` s and return the setpoint. After the end it stands at the target, or moves on at
        the velocity. `dt` must not be negative; RangeError if it is not finite."""
        if self._duration:
            elapsed = self._elapsed + dt
            if not -inf < elapsed < self._duration:  # NaN as well, with which ruckig would read beyond its memory
                return self._end(elapsed - self._duration)
            self._elapsed = elapsed
            scale = self._scale
            (position,), (velocity,), (acceleration,) = self._trajectory.at_time(elapsed)
            self.setpoint = Setpoint(position / scale + self._origin, velocity / scale, acceleration / scale)
        elif moving := self.setpoint.velocity:
            _check_time(dt)
            self.setpoint = Setpoint(self.setpoint.position + moving * dt, moving, 0.0)
        return self.setpoint

    def _end(self, beyond: float) -> Setpoint:
        """The setpoint at a time in s beyond the end of the trajectory."""
        _check_time(beyond)
        (position,), *_ = self._trajectory.at_time(self._duration)
        self._duration = 0.0
        self.setpoint = Setpoint(position / self._scale + self._origin + self._final * beyond, self._final, 0.0)
        return self.setpoint


def _check_time(time: float) -> None:
    if not isfinite(time):
        raise RangeError(f"no step of {time!r} s: it must be finite")


def _ruckig() -> ModuleType:
    """Imported with the first profile and not with umo: it takes 0.2 s."""
    import ruckig

    return ruckig  # type: ignore[no-any-return]
