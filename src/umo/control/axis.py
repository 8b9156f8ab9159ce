"""Axes of motion: the common part of servo axes and stepper axes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from enum import Enum
from math import copysign, inf, isfinite, isnan, nan
from typing import Any, Protocol, cast

from umo.control.axis_state import ACTIONS, FOLLOWED_BY, AxisState
from umo.control.checks import check_numbers
from umo.control.inputs import HOMING, Accept, value_of
from umo.control.profile import Profile
from umo.cycle.parallel import together
from umo.cycle.sequences import one_period
from umo.digits import digits_of, number_text
from umo.errors import AxisError, Busy, DeclarationError, EquipmentFault, HomingError, RangeError, TaskFailed
from umo.objects import Actuator, Compound, DigitalSensor, Number, Quality, Range, action
from umo.objects.keywords import declared_reaction
from umo.objects.link import Task
from umo.objects.presentation.value_text import measure, span
from umo.text import cut_repr, some
from umo.user_code import told

ACCEPTED_WHEN_REFERENCED = Quality.OUT_OF_RANGE
"""The quality that is also accepted for a referenced encoder, because an axis at an end of its range may stand slightly
outside of the range. The setpoint is within the range, and the axis is within `following_error` of the setpoint."""
STANDSTILL_SHARE = 1 / 20
"""The least advance of an axis, as a share of `stall`. An axis that advances less stands still."""
RETURN_WINDOWS = 2.0
"""The largest distance from the position in which an axis was left to a position in which it can continue, in units of
`window`. One window is for the motion back, one for the rounding of the shown position."""


class SearchResult(Enum):
    """The event that ended a search."""

    CONDITION = "condition"
    JUMP = "jump"
    """The reading has changed by more than the axis can move: the counter was loaded or has rolled over."""
    STOP = "stop"
    """The axis stands still although it is driven."""
    REACH = "reach"
    """The axis was driven for the whole distance, and none of the other events has occurred."""


class Interruption(Enum):
    """The way in which a motion continues after an interruption: whether the motion is planned again, and from which
    position."""

    NONE = "none"
    WAITED = "waited"
    """The sequence that moves the axis has waited and continues: the motion starts from the setpoint."""
    INHIBITED = "inhibited"
    """An interlock has inhibited the axis: the motion starts from its present position."""


# An attribute of an Enum is a call.
_DISABLED, _STANDSTILL, _FREE = AxisState.DISABLED, AxisState.STANDSTILL, Interruption.NONE


@dataclass(eq=False)
class Motion:
    """A motion, from its beginning to its end."""

    state: AxisState
    """The state of the axis during the motion."""
    by: Task | None = None
    """The sequence that has begun a jog, or None if another caller began it."""
    awaited: bool = False
    """True if a sequence awaits the end of the motion."""
    was_disabled: bool = False
    """True if the motion ends because other code has disabled the axis. This is an error of the awaiting sequence, but
    not a fault."""


class Homing(Protocol):
    """The way in which an axis finds its reference."""

    async def find(self, axis: Axis) -> None:
        """Search for the reference, call `axis.reference()`, and come to standstill within the range. Raises
        HomingError if the reference was not found. The speed of the search is `axis.search_speed`."""


def _per_second(power: int = 1) -> Callable[[Axis], str]:
    return lambda axis: f"{axis.encoder.units or 1}/s" + (f"**{power}" if power > 1 else "")


def _limits(axis: Axis, name: str, power: int = 1) -> tuple[str, float, float]:
    """Return the unit and the range of a number: from a thousandth of the declared number up to the declared number."""
    return _per_second(power)(axis), getattr(axis, name) / 1000, getattr(axis, name)


def _numbers(axis: Axis) -> dict[str, Number]:
    """Return the setpoint and the error, which are shown, and the numbers of the profile, which can be tuned."""
    shown = Number(axis.encoder.units, shown=True)
    powers = {"velocity": 1, "acceleration": 2, "jerk": 3}
    profile = {f"profile.{name}": Number(*_limits(axis, name, power), tunable=True) for name, power in powers.items()}
    return {"setpoint": shown, "error": shown, **profile}


class Axis(Compound, numbers=_numbers, equipment="manual"):
    """Base of axes of motion, each with its position sensor. Use `ServoAxis` or `StepperAxis`.

    Positions are in the units of the encoder, speeds in units per s. The range of `move_to` and `jog` is the declared
    range of the encoder. While an interlock inhibits the axis, a motion waits. Afterwards it continues to its target
    from the present position. An axis without a motion afterwards stays where it is. A `move_to` that is cancelled
    decelerates to standstill. A motion that fails is a fault if the axis is equipment. An axis is equipment in manual
    mode, and also in automatic mode if its class declares `equipment` (`class Slide(ServoAxis, equipment=True)`).
    Homing that fails or is cancelled disables the axis. `setup` reads the numbers of the axis. To change them later,
    change the numbers of `profile` and, for a servo axis, of `servo`.
    """

    encoder: DigitalSensor
    velocity: float
    """Largest speed, units per s."""
    acceleration: float
    """Largest acceleration, units per s squared."""
    jerk: float
    """Largest jerk, units per s cubed."""
    window: float
    """Distance from the target within which an axis has arrived: a motion ends when the setpoint is at the target and
    the encoder has been within this distance for `window_time`."""
    following_error: float
    """The largest distance between setpoint and encoder. At a larger distance AxisError is raised."""
    window_time: float = 0.02
    """Time in s for which the encoder must be within `window` (CiA 402: position window time)."""
    settling_time: float = 1.0
    """Largest time in s from the end of the profile until the encoder is within `window`."""
    search_speed: float = inf
    """The speed of homing, units per s. Default: the largest speed."""
    stall: float = inf
    """If an axis is driven for this distance during homing without moving, it is taken to stand at an end stop. By
    default no distance is enough."""
    homing: Homing | None = None
    """The way in which the reference is found: `IndexPulse`, `HomeSwitch`, `EndStop`, or a class that you write."""

    _state = _DISABLED
    """The state of the axis, except for two facts that are known elsewhere: a fault of its equipment, and a setpoint
    that still moves."""
    _interrupted = Interruption.NONE

    def setup(self) -> None:
        names = ("velocity", "acceleration", "jerk", "window", "following_error", "settling_time")
        check_numbers(self, above_0=(*names, "search_speed", "stall"), not_negative=("window_time",))
        self.profile = Profile(velocity=self.velocity, acceleration=self.acceleration, jerk=self.jerk)
        self._accept: Accept = ACCEPTED_WHEN_REFERENCED
        """The qualities of the encoder that are accepted in addition to GOOD and STALE."""
        self._replan: Callable[[], object] = self._stand
        """The function that plans the activity of the axis again, from the setpoint at this time."""
        self._motion: Motion | None = None
        """The motion that the axis carries out, if the axis is in a state of motion. No other motion ends it."""

    # Motions -------------------------------------------------------------------------------------------

    @action
    async def home(self) -> None:
        """Find the reference. The axis then stands still, and the encoder is referenced. Raises HomingError if the
        reference is not found."""
        if self.homing is None:
            raise DeclarationError(f"{self._path} does not declare how it is homed (`homing`)")
        with self._claimed(AxisState.HOMING, HOMING):
            self.encoder.referenced(False)
            await self._settle()
            await self.homing.find(self)
            self._accept = ACCEPTED_WHEN_REFERENCED
            await self._settle()

    @action(
        position=lambda axis: Range.of(axis.encoder),
        speed=lambda axis: Range(*_limits(axis, "velocity")),
        duration=lambda axis: Range("s", 0.0, 3600.0),  # here, as a unit needs pint, which is not imported with umo
    )
    async def move_to(self, position: float, *, speed: float = inf, duration: float = 0.0) -> None:
        """Move to a position with limited jerk. The speed is at most `speed`, and the motion takes at least `duration`
        s. The motion ends when the encoder has arrived. Raises RangeError if the position is outside the encoder's
        range, BadInput if the encoder is not referenced, AxisError if the axis does not arrive, Busy during another
        motion.
        """
        self.check_target(position)
        if not speed > 0.0:
            raise RangeError(f"{self._path}: the speed must be above 0, not {speed}")
        if not 0.0 <= duration < inf:
            raise RangeError(f"{self._path}: the duration must be finite and not negative, not {duration} s")
        with self._claimed(AxisState.DISCRETE_MOTION, ACCEPTED_WHEN_REFERENCED):
            await self.travel(position, speed=speed, duration=duration)

    @action(velocity=lambda axis: Range(_per_second()(axis), -axis.velocity, axis.velocity), release="halt")
    def jog(self, velocity: float) -> None:
        """Move at this velocity (units per s) until the next call; 0 means `halt`. A referenced axis stops at the end
        of its range. Raises Busy during another motion, RangeError for NaN and infinity."""
        if not isfinite(velocity):
            raise RangeError(f"{self._path}: {velocity} is not a velocity")
        if not velocity:
            self._check_free(AxisState.CONTINUOUS_MOTION)
            self.halt()
            return
        unreferenced = self.encoder.quality is Quality.UNREFERENCED
        self._prepare(AxisState.CONTINUOUS_MOTION, HOMING if unreferenced else ACCEPTED_WHEN_REFERENCED)
        self._go(lambda: self._jog(velocity))
        self._begin(Motion(AxisState.CONTINUOUS_MOTION, by=self._machine.current_task))

    def halt(self) -> None:
        """End a jog, even one that another caller began: decelerate to standstill. An axis that is not enabled, or that
        carries out another motion, is not affected."""
        if self._state is AxisState.CONTINUOUS_MOTION:
            self._halt()

    def _jog(self, velocity: float) -> None:
        end = self.encoder.maximum if velocity > 0 else self.encoder.minimum
        if self.encoder.quality is Quality.UNREFERENCED:
            self._cruise(velocity)
        elif velocity * (end - self.setpoint) > 0:
            self.profile.to(end, velocity=self._speed(abs(velocity)))
        else:
            self.profile.at(0.0)

    def _cruise(self, velocity: float) -> None:
        self.profile.at(copysign(self._speed(abs(velocity)), velocity))

    def time_to(self, position: float) -> float:
        """Return the duration of a motion from standstill to a position at the largest speed, in s."""
        self.check_target(position)
        ahead = replace(self.profile, velocity=self._speed(inf))
        ahead.hold(self.setpoint if self.enabled else value_of(self.encoder, ACCEPTED_WHEN_REFERENCED))
        return ahead.to(position)

    def enable(self) -> None:
        """Let the axis follow its setpoint, from its present position. Raises BadInput if the encoder's quality is not
        accepted, EquipmentFault if the axis is in fault."""
        if self._state is _DISABLED:
            if self._machine.fault_of(self) is not None:  # no local name: the frame of an error must not refer to it
                raise cast(EquipmentFault, self._machine.fault_of(self))
            self._stand()
            self._interrupted, self._replan, self._motion = Interruption.NONE, self._stand, None
            self._enter(_STANDSTILL)

    @action
    def disable(self) -> None:
        """Stop following the setpoint: the actuators go to their defaults. A motion in progress ends with AxisError,
        which is not a fault."""
        self._enter(_DISABLED)
        self._accept = ACCEPTED_WHEN_REFERENCED

    @property
    def enabled(self) -> bool:
        """True if the axis follows its setpoint. The first motion enables it."""
        return self._state is not _DISABLED

    @property
    def state(self) -> AxisState:
        """The state of the axis, in PLCopen's terms."""
        return self._seen_state()

    def _seen_state(self) -> AxisState:
        if self._state is _DISABLED and self._machine.fault_of(self) is not None:
            return AxisState.ERROR_STOP
        stops = self._state is _STANDSTILL and not self.profile.done
        return AxisState.STOPPING if stops else self._state

    def shown_state(self) -> AxisState:
        """Return the state shown to clients, which the axis itself computes; only the program reads the `state` of a
        subclass. If an error occurs, such as an invalid `profile`, the state is ERROR_STOP."""
        try:  # not by `attempt`: a call for each in every period is too dear
            return self._seen_state()
        except BaseException as error:
            told(error)
            return AxisState.ERROR_STOP

    def describe_axis(self) -> Mapping[str, Any]:
        """Return the axis as plain data: its states, the paths of its objects, its limits in units of the encoder and
        s."""
        path, encoder = self._path, self.encoder
        return {
            "path": path,
            "states": [state.name.lower() for state in AxisState],
            "position": encoder._path,
            "units": encoder.units,
            "minimum": encoder.minimum,
            "maximum": encoder.maximum,
            "window": self.window,
            "setpoint": f"{path}.setpoint",
            "error": f"{path}.error",
            "velocity": f"{path}.profile.velocity",
            "acceleration": f"{path}.profile.acceleration",
            "largest": {"velocity": self.velocity, "acceleration": self.acceleration, "jerk": self.jerk},
            "move": f"{path}.move_to",
            "jog": f"{path}.jog",
            "disable": f"{path}.disable",
            "home": None if self.homing is None else f"{path}.home",
        }

    # For homing ----------------------------------------------------------------------------------------

    @property
    def reading(self) -> float:
        """The encoder's value, even if the encoder is not referenced."""
        return value_of(self.encoder, HOMING)

    async def search(
        self,
        velocity: float,
        until: Callable[[], bool] | None = None,
        *,
        jump: float = inf,
        reach: float | None = None,
    ) -> SearchResult:
        """Move at a velocity until the condition is true, the reading jumps by more than `jump` in a period, the axis
        stands still, or the axis was driven for the distance `reach` (default: three times the range of the encoder).
        The motion continues afterwards, except at a standstill."""
        if reach is None:
            reach = 3 * (self.encoder.maximum - self.encoder.minimum)
        if isnan(jump) or isnan(reach):
            raise RangeError(f"{self._path}: jump={jump} and reach={reach} of a search must be numbers")
        motion = self._motion
        self._go(lambda: self._cruise(velocity))
        sign = copysign(1.0, velocity)
        driven = idle = 0.0
        last = best = self.reading
        while until is None or not until():
            tick = await one_period()
            self._check(motion)
            reading = self.reading
            if self._interrupted is not _FREE:
                last, best, idle = reading, reading, 0.0
                continue
            missed = (tick.ticks - 1) * tick.period  # s, in which the axis has moved on
            if abs(reading - last) > jump + missed * abs(self.profile.setpoint.velocity):
                self._shift(reading - last)
                return SearchResult.JUMP
            distance = sign * self.profile.setpoint.velocity * tick.period  # below 0 until a motion before has ended
            driven, idle, last = driven + max(distance, 0.0), idle + distance, reading
            if distance <= 0.0 or sign * (reading - best) > STANDSTILL_SHARE * self.stall:
                best, idle = reading, 0.0
            if idle > self.stall:
                self._stand()
                return SearchResult.STOP
            if driven > reach:
                return SearchResult.REACH
        return SearchResult.CONDITION

    def reference(self, at: float | None = None) -> None:
        """Mark the encoder as referenced. `at`: the position that the last reading stands for; None leaves the readings
        unchanged."""
        before = self.reading
        self.encoder.referenced(at=at)
        self._shift(self.reading - before)

    async def travel(self, position: float, *, speed: float = inf, duration: float = 0.0) -> None:
        """Move to a position, even beyond the range. The motion ends when the encoder has arrived. Raises AxisError if
        the encoder does not arrive."""
        end = self.now + duration  # after an interruption only what is left of the duration counts
        motion = self._motion
        try:
            self._go(lambda: self.profile.to(position, velocity=self._speed(speed), duration=max(end - self.now, 0.0)))
            late, corrections = 0.0, 0
            steady = -inf  # how long it has been in the window; -inf: it is not
            while steady < self.window_time:
                tick = await one_period()
                self._check(motion)
                period = tick.dt / tick.ticks  # in missed periods nothing was controlled, and nothing seen
                if self._interrupted is not _FREE or not self.profile.done:
                    late, steady = 0.0, -inf
                elif self._arrived(position):
                    steady = max(steady + period, 0.0)
                else:
                    late, steady = late + period, -inf
                    if late > self.settling_time:
                        late, corrections = 0.0, corrections + 1
                        self._correct(position, corrections)
        except BaseException:
            if self.enabled and self._motion is motion:
                self._go(lambda: self.profile.at(0.0))
            raise
        self._replan = self._stand

    # What the two kinds do in their own way ------------------------------------------------------------

    @property
    @abstractmethod
    def error(self) -> float:
        """Setpoint minus reading in the last period, in units of the encoder."""

    @property
    def setpoint(self) -> float:
        """The position that the axis follows; NaN while it is not enabled."""
        return nan if self._state is _DISABLED else self.profile.setpoint.position

    @property
    def _outputs(self) -> tuple[Actuator, ...]:
        """The actuators that the law of the axis drives while the axis is enabled, including those not written in this
        period."""
        return ()

    @abstractmethod
    def _stand(self) -> None:
        """Set the setpoint to the position at which the axis stands."""

    def _shift(self, distance: float) -> None:
        """Take into account that the reading has changed by this distance although the axis has not moved."""
        self.profile.shift(distance)

    def _speed(self, wanted: float) -> float:
        """Return the wanted speed, or the largest speed that the axis can have."""
        return min(wanted, self.profile.velocity)

    async def _settle(self) -> None:
        """Wait until the axis has come to rest, before and after homing."""

    def _arrived(self, position: float) -> bool:
        """Return True if the axis is in position. Called after the end of the profile."""
        return abs(position - self.reading) < self.window

    def _correct(self, position: float, corrections: int) -> None:
        """Correct the position, or raise AxisError, because the axis has not arrived within `settling_time` after the
        end of the profile. `corrections`: the number of earlier corrections of this motion."""
        away = measure(self.reading, self.encoder.units)
        raise AxisError(f"{self._path} did not arrive at {number_text(position)}: it is at {away}")

    def _disconnect(self) -> None:
        """Disconnect the axis. The next connection begins with an axis that is not enabled."""
        super()._disconnect()
        self._state, self._motion, self._interrupted = _DISABLED, None, Interruption.NONE

    def check_target(self, position: float) -> None:
        """Check a target. Raises RangeError if `move_to` would refuse it."""
        low, high = self.encoder.minimum, self.encoder.maximum
        if not low <= position <= high:
            raise RangeError(f"{self._path}: {measure(position, self.encoder.units)} is outside {span(low, high)}")

    # Inside --------------------------------------------------------------------------------------------

    def _enter(self, state: AxisState) -> None:
        """Change the state, as `FOLLOWED_BY` allows. The state changes only here."""
        self._state = state

    def _check_free(self, state: AxisState) -> None:
        """Raise Busy during a motion that the motion of this state cannot follow."""
        if self._state in ACTIONS and state not in FOLLOWED_BY[self._state]:
            busy, wanted = ACTIONS[self._state], ACTIONS[state]
            raise Busy(f"{self._path} is busy with {busy}; {wanted} was not started")

    def _prepare(self, state: AxisState, accept: Accept) -> None:
        """Enable the axis for a motion. Raises Busy during another motion, BadInput if the encoder's quality is not
        accepted, and AxisError, which is a fault of equipment, if the axis cannot be enabled."""
        self._check_free(state)
        if self.enabled:
            value_of(self.encoder, accept)
        self._accept = accept
        try:
            self.enable()
            if not self.enabled:
                raise AxisError(f"{self._path} was not enabled")
        except AxisError as error:
            self._machine.fail(self, error)
            raise

    def _begin(self, motion: Motion) -> None:
        """Begin this motion."""
        self._motion = motion
        self._enter(motion.state)

    def _end(self) -> None:
        """End the motion in progress, if there is one."""
        self._motion = None
        if self.enabled:
            self._enter(_STANDSTILL)

    def _halt(self) -> None:
        """Decelerate to standstill, whatever the axis does."""
        self._go(lambda: self.profile.at(0.0))
        self._end()

    @contextmanager
    def _claimed(self, state: AxisState, accept: Accept) -> Iterator[None]:
        """Return a context for a motion; no other motion can begin within it. `accept`: the accepted qualities of the
        encoder. The errors are those of `_prepare`."""
        self._prepare(state, accept)
        motion = Motion(state, awaited=True)
        self._begin(motion)
        try:
            yield
        except BaseException as error:
            if state is AxisState.HOMING and self.enabled and self._motion is motion:
                self._let_go()
            if isinstance(error, AxisError | HomingError) and not motion.was_disabled:
                self._machine.fail(self, error)
            raise
        finally:
            motion.awaited = False
            if self._motion is motion:
                self._end()
                self._accept = ACCEPTED_WHEN_REFERENCED

    def _go(self, plan: Callable[[], object]) -> None:
        """Plan a motion now, and plan it again after an interruption."""
        plan()
        self._replan = plan

    def _enter_fault(self) -> None:
        super()._enter_fault()
        self._let_go()

    def _let_go(self) -> None:
        """Disable the axis. The axis is not controlled any more, even if `disable` of a subclass fails."""
        try:
            self.disable()
        finally:
            Axis.disable(self)

    def _check(self, motion: Motion | None) -> None:
        """Raise the fault of the axis, or else AxisError, if the axis was disabled after the beginning of this
        motion."""
        if self._state is _DISABLED or self._motion is not motion:
            if motion is not None:
                motion.was_disabled = True
            raise self._machine.fault_of(self) or AxisError(f"{self._path} was disabled during its motion")

    def _interrupt(self) -> None:
        """Handle an interlock that inhibits the axis: the setpoint stays at the position of the axis."""
        self._interrupted = Interruption.INHIBITED
        self._stand()

    def _go_on(self) -> None:
        if self._interrupted is Interruption.INHIBITED:
            self._stand()
        self._interrupted = Interruption.NONE
        self._plan_anew()

    def _plan_anew(self) -> None:
        """Plan the motion again from the setpoint. A controller that has no host (TaskFailed), or whose host has not
        answered yet, cannot plan the motion and brakes to standstill."""
        self.profile.at(0.0)
        with suppress(TaskFailed):
            self._replan()

    def _brake(self) -> None:
        """Decelerate to standstill, because nothing controls the axis any more."""
        if self._state is not _DISABLED:
            self.profile.at(0.0)

    def _moves(self) -> bool:
        """Return True if the setpoint moves."""
        return self._state is not _DISABLED and not (self.profile.done and not self.profile.setpoint.velocity)

    # While another is in charge (`umo.operation.commands.suspension`) -------------------------------------------------

    def _leave(self) -> LeftMotion:
        """Store the motion of the axis, because the sequence that moves the axis has to wait, and free the axis for
        another motion."""
        left = LeftMotion(self)
        self._end()
        if left.state is AxisState.HOMING:
            self._accept = HOMING
        return left

    def _stop_as_declared(self, left: LeftMotion | None) -> str:
        """Carry out the declared reaction, because nothing controls the axis any more. Return the reaction as a text;
        "" if nothing changes. `left`: the activity of the axis before."""
        reaction = declared_reaction(self) or "hold"
        if not self.enabled:
            return ""
        if reaction == "default":
            self.disable()
            return "is disabled"
        searched = left is not None and left.state is AxisState.HOMING
        if searched and not abs(self.error) <= self.following_error:  # it pushes against an end stop
            self._stand()
        moves = self._moves()
        if reaction == "run on" and self._ends_by_itself(left):
            return "moves on to its end" if moves else ""
        self._halt()
        return "stops" if moves else ""

    def _ends_by_itself(self, left: LeftMotion | None) -> bool:
        """Return True if the activity of the axis ends by itself. A jog, a search, and a motion that is still to be
        planned again do not."""
        states = (self._state, left and left.state)
        endless = AxisState.CONTINUOUS_MOTION in states or AxisState.HOMING in states
        return self.profile.stops and self._interrupted is Interruption.NONE and not endless

    def _driven(self) -> tuple[Actuator, ...]:
        """Return the actuators that the law of the axis controls, including those not written in this period."""
        return self._outputs if self.enabled else ()


class LeftMotion:
    """The activity of an axis at the time when its sequence was suspended, and the continuation of this activity."""

    def __init__(self, axis: Axis) -> None:
        self._axis = axis
        self.state = axis._state
        """The state in which the axis was left."""
        self._motion, self._replan, self._accept = axis._motion, axis._replan, axis._accept
        by = None if self._motion is None else self._motion.by
        self._by = None if by is None or by.done else by
        """The sequence that jogs and ends the jog; None if the caller that began the jog has ended or is not a
        sequence."""
        quality, searched = axis.encoder.quality, self.state is AxisState.HOMING
        self._referenced = quality is not Quality.UNREFERENCED and not (searched and quality is Quality.BAD)
        rests = self.state is _STANDSTILL and not axis._moves()
        self._position = axis.profile.setpoint.position if rests else nan
        """The position at which the axis stood while it was enabled; NaN if it did not stand or was not enabled."""

    @property
    def _goes_on(self) -> bool:
        """True if there is a motion to continue, because the sequence that awaits the motion, or that jogs, was not
        cancelled."""
        if self._motion is None:
            return False
        if self._motion.state is AxisState.CONTINUOUS_MOTION:
            return self._by is None or not self._by.done
        return self._motion.awaited

    @property
    def _next_state(self) -> AxisState:
        """The state in which the axis continues. If homing was cancelled, the axis is disabled."""
        if self._motion is None or self.state is _DISABLED or self._goes_on:
            return self.state
        return _DISABLED if self.state is AxisState.HOMING else _STANDSTILL

    def why_not(self) -> str:
        """Return the reason why the axis cannot continue, and what to do; "" if it can."""
        axis = self._axis
        if self._next_state is _DISABLED:
            return ""
        path, encoder = axis._path, axis.encoder
        if encoder.quality is Quality.BAD:
            return f"the reading of {encoder.path} is BAD; wait until it is good"
        referenced = encoder.quality is not Quality.UNREFERENCED
        if self._referenced and not referenced:
            return f"{path} has lost its reference; home it (`{path}.home`)"
        if isnan(self._position) or referenced is not self._referenced:
            return ""
        if axis._moves():
            return f"{path} still moves; wait until it stands"
        if abs(axis.reading - self._position) <= RETURN_WINDOWS * axis.window:
            return ""
        digits = digits_of(encoder.resolution, encoder.zero_offset)
        here, there = (measure(position, encoder.units, digits) for position in (axis.reading, self._position))
        return f"{path} is at {here}, the application left it at {there}; move it back (`{path}.move_to`)"

    def restore(self) -> None:
        """Enable the axis at its present position if it was enabled before, otherwise disable it."""
        axis, enabled = self._axis, self._next_state is not _DISABLED
        if enabled and not axis.enabled:
            axis._accept = HOMING
            axis.enable()
        elif axis.enabled and not enabled:
            axis.disable()

    def go_on(self) -> None:
        """Continue in the state in which the axis was left, with its motion planned again from the setpoint."""
        axis, state, goes_on = self._axis, self._next_state, self._goes_on
        axis._end()
        axis._accept, axis._motion = self._accept, self._motion if goes_on else None
        if axis.enabled and state is not _DISABLED:
            axis._enter(state)
            if goes_on:
                axis._replan, axis._interrupted = self._replan, Interruption.WAITED

    def is_lost(self) -> bool:
        """Return True if a sequence still awaits a motion that ended because of a fault that has since been cleared."""
        return self._motion is not None and self._motion.awaited and self._axis.cycle.fault is None


async def move_together(*moves: tuple[Axis, float]) -> None:
    """Move several axes so that they start and arrive together. Each argument is a pair `(axis, position)`. Raises
    TypeError for anything other than such pairs, and ValueError for an axis that is given twice; then no axis moves."""
    for each in moves:
        if not isinstance(each, tuple | list) or len(each) != 2 or not isinstance(each[0], Axis):
            raise TypeError(f"move_together() takes pairs such as `(axis, 80.0)`, not {cut_repr(each)}")
    if twice := [axis._path for n, (axis, _) in enumerate(moves) if axis in [other for other, _ in moves[:n]]]:
        raise ValueError(f"move_together() has {some(twice)} twice")
    duration = max((axis.time_to(position) for axis, position in moves), default=0.0)
    await together(*(axis.move_to(position, duration=duration) for axis, position in moves))
