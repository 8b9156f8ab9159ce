"""An axis in a change to manual mode, and back (`umo.cycle.suspension` calls it)."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan, nan
from typing import NamedTuple, Protocol

from umo.control.inputs import HOMING, Accept
from umo.control.profile import Profile
from umo.objects import Actuator, DigitalSensor, Quality
from umo.objects.link import Cycle, Task
from umo.presentation.digits import digits_of
from umo.presentation.value_text import measure

RETURN_WINDOWS = 2.0
"""Distance in windows from where the application left an axis within which it goes on: one of the motion back, and one
of the digits in which the position is told."""


class _Left(NamedTuple):
    """What the application did with an axis when it was suspended."""

    motion: str | None
    replan: Callable[[], object]
    enabled: bool
    searching: bool
    accept: Accept
    referenced: bool
    position: float
    """The position at which it stood, enabled; NaN: it did not."""
    number: int
    """Number of its motion."""
    jogged_by: Task | None
    """The sequence that jogs, and ends the jog; None: it was begun by what has ended, or is no sequence."""

    @property
    def goes_on(self) -> bool:
        """Whether there is a motion to go on with: not a jog whose sequence was cancelled."""
        return self.motion is not None and (self.jogged_by is None or not self.jogged_by.done)


class SuspendedAxis(Protocol):
    """An axis (`umo.control.Axis`), as far as its suspension needs it."""

    encoder: DigitalSensor
    profile: Profile
    window: float
    following_error: float
    enabled: bool
    searching: bool
    _motion: str | None
    _accept: Accept
    _replan: Callable[[], object]
    _interrupted: bool
    _in_charge: int
    _jogged_by: Task | None
    _awaited: set[int]

    @property
    def _path(self) -> str: ...
    @property
    def _outputs(self) -> tuple[Actuator, ...]: ...
    @property
    def cycle(self) -> Cycle: ...
    @property
    def reading(self) -> float: ...
    @property
    def error(self) -> float: ...
    def enable(self) -> None: ...
    def disable(self) -> None: ...
    def _let_go(self) -> None: ...
    def _stand(self) -> None: ...
    def _go(self, plan: Callable[[], object]) -> None: ...
    def _set_searching(self, searching: bool) -> None: ...


class AxisSuspension:
    """One axis: what it does while nobody is in charge of it, and what the application had done with it."""

    def __init__(self, axis: SuspendedAxis, declared: Callable[[], str | None]) -> None:
        """`declared`: the reaction that the axis, or a compound around it, declares."""
        self._axis, self._declared = axis, declared
        self._left: _Left | None = None
        self._lost = 0
        """Number of the application's motion that a fault has ended; 0: of none."""

    def suspend(self) -> None:
        """The application is suspended: keep what it does with the axis, which is free for another motion then."""
        axis = self._axis
        setpoint, quality = axis.profile.setpoint, axis.encoder.quality
        referenced = quality is not Quality.UNREFERENCED and not (axis.searching and quality is Quality.BAD)
        rests = axis.enabled and axis._motion is None and axis.profile.done and not setpoint.velocity
        position = setpoint.position if rests else nan
        was = axis._motion, axis._replan, axis.enabled, axis.searching, axis._accept, referenced
        jogged_by = axis._jogged_by
        if axis._motion != "jog" or (jogged_by is not None and jogged_by.done):
            jogged_by = None
        self._left = _Left(*was, position, axis._in_charge, jogged_by)
        axis._motion = None
        if axis.searching:
            pushes = axis.enabled and not abs(axis.error) <= axis.following_error  # against an end stop
            axis._set_searching(False)
            axis._accept = HOMING
            if pushes:
                axis._stand()

    def disable(self) -> None:
        """It could not be suspended: it is controlled no longer."""
        self._axis._let_go()

    def stop_as_declared(self) -> str:
        """Nobody is in charge of the axis: the declared reaction, in words; "": nothing changes."""
        axis, reaction = self._axis, self._declared() or "hold"
        if not axis.enabled:
            return ""
        if reaction == "default":
            axis.disable()
            return "is disabled"
        moves = not axis.profile.done or bool(axis.profile.setpoint.velocity)
        if reaction == "run on" and self._has_end():
            return "moves on to its end" if moves else ""
        axis._go(lambda: axis.profile.at(0.0))
        axis._motion = None
        return "stops" if moves else ""

    def _has_end(self) -> bool:
        """Whether what the axis does ends by itself: not a jog or a search, and not what an interlock has interrupted,
        which is planned anew."""
        axis, left = self._axis, self._left
        jogs = "jog" in (axis._motion, left and left.motion)
        return axis.profile.stops and not (jogs or axis._interrupted or (left is not None and left.searching))

    def why_not_resumed(self) -> str:
        """Why the application cannot go on with the axis; "": it can."""
        axis, left = self._axis, self._left
        if left is None or not left.enabled:
            return ""
        path, encoder = axis._path, axis.encoder
        if encoder.quality is Quality.BAD:
            return f"the reading of {encoder.path} is BAD"
        referenced = encoder.quality is not Quality.UNREFERENCED
        if left.referenced and not referenced:
            return f"{path} has lost its reference; home it (`{path}.home`)"
        if isnan(left.position) or referenced is not left.referenced:
            return ""
        if axis.enabled and not (axis.profile.done and not axis.profile.setpoint.velocity):
            return f"{path} still moves"
        if abs(axis.reading - left.position) <= RETURN_WINDOWS * axis.window:
            return ""
        digits = digits_of(encoder.resolution, encoder.zero_offset)
        here, there = (measure(position, encoder.units, digits) for position in (axis.reading, left.position))
        return f"{path} stands at {here}, the application left it at {there}; move it back (`{path}.move_to`)"

    def restore(self) -> None:
        """It is enabled, where it stands, if it was when the application left it; and disabled if it was not."""
        axis, left = self._axis, self._left
        if left is None:
            return
        if left.enabled and not axis.enabled:
            axis._accept = HOMING
            axis.enable()
        elif axis.enabled and not left.enabled:
            axis.disable()

    def forget(self) -> None:
        """The axis is in fault: what the application did with it has ended."""
        left, self._left = self._left, None
        if left is not None and left.motion is not None:
            self._lost = left.number

    def motion_ended(self, number: int) -> None:
        """A motion has ended. If it is that of the suspended application, it was cancelled: the application goes on
        without it. Homing that is cancelled leaves the axis disabled."""
        left = self._left
        if left is not None and left.number == number:
            enabled = left.enabled and left.motion != "home"
            self._left = left._replace(motion=None, searching=False, enabled=enabled)

    def driven(self) -> tuple[Actuator, ...]:
        """What its law is in charge of."""
        return self._axis._outputs if self._axis.enabled else ()

    def is_lost(self) -> bool:
        """Whether a sequence of the application still awaits a motion that a fault has ended, and that was cleared."""
        return self._lost in self._axis._awaited and self._axis.cycle.fault is None

    def resume(self) -> None:
        """The application goes on: its motion is planned anew."""
        axis, left = self._axis, self._left
        self._left = None
        if left is None:
            return
        axis._motion, axis._in_charge = left.motion if left.goes_on else None, left.number
        axis._jogged_by = left.jogged_by
        axis._set_searching(left.searching)
        axis._accept = left.accept
        if left.goes_on and left.enabled:
            axis._replan, axis._interrupted = left.replan, True
