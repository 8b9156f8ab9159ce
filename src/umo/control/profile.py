"""Jerk-limited motion profiles, through ruckig (time-optimal, any starting state)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from types import ModuleType
from typing import Any, NamedTuple

from umo.errors import RangeError


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
    _elapsed: float = field(default=0.0, init=False)
    _duration: float = field(default=0.0, init=False)

    def hold(self, position: float, velocity: float = 0.0) -> None:
        """Set the start position and velocity of the next profile."""
        self.setpoint = Setpoint(position, velocity, 0.0)
        self._duration = 0.0

    def to(self, target: float, *, velocity: float = inf, duration: float = 0.0) -> float:
        """Plan a profile from the current setpoint to standstill at the target. Returns its duration in s.

        `velocity` lowers the largest speed for this profile. `duration` is the least time in s that it takes: several
        axes with the duration of the slowest arrive together (`synchronize`). RangeError if a number is not finite or a
        limit is not positive.
        """
        ruckig = _ruckig()
        plan = ruckig.InputParameter(1)
        plan.current_position = [self.setpoint.position]
        plan.current_velocity = [self.setpoint.velocity]
        plan.current_acceleration = [self.setpoint.acceleration]
        plan.target_position = [target]
        plan.max_velocity = [min(velocity, self.velocity)]
        plan.max_acceleration = [self.acceleration]
        plan.max_jerk = [self.jerk]
        if duration:
            plan.minimum_duration = duration
        try:
            result = self._planner.calculate(plan, self._trajectory)
        except ruckig.RuckigError as error:
            raise RangeError(f"no profile to {target!r}: {str(error).strip()}") from None
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise RangeError(f"no profile to {target!r} within the limits of {self!r}: {result.name}")
        self._elapsed = 0.0
        self._duration = float(self._trajectory.duration)
        return self._duration

    @property
    def done(self) -> bool:
        return self._elapsed >= self._duration

    def step(self, dt: float) -> Setpoint:
        """Advance the profile by `dt` s and return the setpoint. After the end it is the target."""
        if self._duration:
            self._elapsed = elapsed = self._elapsed + dt
            if elapsed >= self._duration:
                elapsed, self._duration = self._duration, 0.0
            (position,), (velocity,), (acceleration,) = self._trajectory.at_time(elapsed)
            self.setpoint = Setpoint(position, velocity, acceleration)
        return self.setpoint


def synchronize(*moves: tuple[Profile, float]) -> float:
    """Plan profiles to their targets, `(profile, target)` each, that begin and end together: with the duration of the
    slowest. Returns it in s."""
    longest = max(profile.to(target) for profile, target in moves)
    for profile, target in moves:
        profile.to(target, duration=longest)
    return longest


def _ruckig() -> ModuleType:
    """Imported with the first profile and not with umo: it takes 0.2 s."""
    import ruckig

    return ruckig  # type: ignore[no-any-return]
