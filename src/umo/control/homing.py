"""Homing: an axis finds its reference by an index pulse, a home switch or an end stop (compare CiA 402)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isinf
from typing import Any

from umo.control.axis import STANDSTILL_SHARE, Axis, SearchResult
from umo.control.checks import check_numbers
from umo.control.inputs import state_of
from umo.errors import DeclarationError, HomingError
from umo.objects import BinaryActuator, BinarySensor
from umo.objects.presentation.value_text import measure
from umo.states import TwoState


@dataclass(kw_only=True)
class IndexPulse:
    """Homing on the index pulse of the encoder: the circuit loads its counter at the pulse while the actuator `enable`
    enables this.

    The axis moves in `direction` until the reading jumps to `index`. If the axis reaches the end stop first, it moves
    back across the index. In this case the axis began beyond the index, or the count was already right and did not
    jump.
    """

    enable: BinaryActuator[Any]
    """The actuator that enables the index pulse. The pulse loads the counter while this actuator is not at its
    default."""
    index: float
    """Position of the index pulse."""
    stop: float
    """Position of the end stop in this direction."""
    jump: float
    """A distance larger than the axis can move in one period. If the reading changes by more, the counter was loaded or
    has rolled over."""
    tolerance: float
    """Distance from the true position within which a reading counts as right."""
    clearance: float
    """Distance before the index at which homing ends."""
    direction: int = 1
    """Direction of the search: +1 for larger readings, -1 for smaller ones."""

    def __post_init__(self) -> None:
        _check(self)

    async def find(self, axis: Axis) -> None:
        try:
            if not await self._search(axis, self.direction):
                await self._search_back(axis)
        finally:
            self.enable.write(self.enable.default)
        await axis.travel(self.index - self.direction * self.clearance, speed=axis.search_speed)
        axis.reference()

    def _keep_enabled(self) -> bool:
        """Enable the pulse again after an interlock has reset it. Return False, so that this condition does not end the
        search."""
        enable = self.enable
        enabled = enable.one if enable.default is enable.zero else enable.zero
        if enable.read() is not enabled:
            enable.write(enabled)
        return False

    async def _search(self, axis: Axis, direction: int, reach: float | None = None) -> bool:
        """Search for the index pulse. Return True if it was found. The counter may roll over on the way."""
        while True:
            met = await axis.search(direction * axis.search_speed, self._keep_enabled, jump=self.jump, reach=reach)
            if met is not SearchResult.JUMP:
                return False
            if abs(axis.reading - self.index) <= self.tolerance:
                return True

    async def _search_back(self, axis: Axis) -> None:
        units, at_stop = axis.encoder.units, axis.reading
        if await self._search(axis, -self.direction, 1.5 * abs(self.stop - self.index)):
            return
        here = axis.reading
        if abs(at_stop - self.stop) <= self.tolerance and self.direction * (self.index - here) > 0:
            return
        if abs(here - at_stop) <= STANDSTILL_SHARE * axis.stall:
            raise HomingError(
                f"{axis._path} does not move, or its encoder is dead: the count did not change in either direction"
            )
        raise HomingError(
            f"{axis._path} found no index pulse: the encoder read {measure(at_stop, units)} at the stop, "
            f"then {measure(here, units)}"
        )


@dataclass(kw_only=True)
class HomeSwitch:
    """Homing on a switch that is active at one end of the axis. The reference is the edge that the axis passes slowly
    when it leaves the switch. Bouncing of the switch does no harm when the axis reaches the switch at search speed."""

    switch: BinarySensor[Any]
    active: TwoState
    position: float
    """Position of the edge."""
    creep_speed: float
    """Speed at which the switch is left, units per s."""
    direction: int = -1
    """The end at which the switch is active: -1 at the smaller readings, +1 at the larger ones."""
    clearance: float = 0.0
    """Distance from the edge at which homing ends."""

    def __post_init__(self) -> None:
        _check(self)
        if not self.creep_speed > 0:
            raise DeclarationError(f"creep_speed must be above 0, not {self.creep_speed!r}")

    async def find(self, axis: Axis) -> None:
        toward = self.direction * axis.search_speed
        if not self._is_active() and await axis.search(toward, self._is_active) is not SearchResult.CONDITION:
            raise HomingError(f"{axis._path} found no home switch: {self.switch.path} did not become {self.active}")
        if (
            await axis.search(-self.direction * self.creep_speed, lambda: self._is_left(axis))
            is not SearchResult.CONDITION
        ):
            raise HomingError(f"{axis._path} cannot leave its home switch: {self.switch.path} stays {self.active}")
        axis.reference(at=self.position)
        await axis.travel(self.position - self.direction * self.clearance, speed=axis.search_speed)

    def _is_active(self) -> bool:
        return state_of(self.switch) is self.active

    def _is_left(self, axis: Axis) -> bool:
        """Return True if the switch is not active any more and the axis moves away from it. Before that the switch
        bounces."""
        return not self._is_active() and self.direction * axis.profile.setpoint.velocity < 0.0


@dataclass(kw_only=True)
class EndStop:
    """Homing on a mechanical end stop. `stall` of the axis determines when the axis is taken to stand at the stop;
    `search_output` of a servo axis limits the force."""

    position: float
    """Position of the end stop."""
    direction: int = -1
    """The end at which the stop is: -1 at the smaller readings, +1 at the larger ones."""
    clearance: float = 0.0
    """Distance from the end stop at which homing ends."""

    def __post_init__(self) -> None:
        _check(self)

    async def find(self, axis: Axis) -> None:
        if isinf(axis.stall):
            raise DeclarationError(f"{axis._path}: homing on an end stop requires `stall`")
        if await axis.search(self.direction * axis.search_speed) is not SearchResult.STOP:
            raise HomingError(f"{axis._path} found no end stop")
        axis.reference(at=self.position)
        await axis.travel(self.position - self.direction * self.clearance, speed=axis.search_speed)


def _check(strategy: IndexPulse | HomeSwitch | EndStop) -> None:
    numbers = [field.name for field in fields(strategy) if field.type in ("float", float)]
    check_numbers(strategy, finite=numbers)
    if strategy.direction not in (-1, 1):
        raise DeclarationError(f"{type(strategy).__name__}: direction is -1 or 1, not {strategy.direction!r}")
