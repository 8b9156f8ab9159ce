"""The command stage: what stands between whoever writes a guarded actuator and the process image, as data.

    source, range, interlock, expiry, rate, then the image

The range is judged by the object itself, before anything else. An actuator that has no guard, is synchronous and whose
range its raw integers meet writes into the image directly and pays nothing for this.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from math import copysign
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from umo.cycle.journal import Kind
from umo.cycle.stop_order import stop_sequence
from umo.errors import DriverError, Failure, Interlocked
from umo.objects import Atomic, BinaryActuator, Compound, DigitalActuator, Interlock
from umo.objects.interlock import interlocks_of
from umo.text import cause_of

if TYPE_CHECKING:
    from umo.cycle.image import Image

log = logging.getLogger("umo")
EVENTS = 1000
A_TICK = 1e-9
"""s by which a sum of periods may fall short of the time that it stands for."""


class Source(Enum):
    """Who commands an actuator."""

    PROGRAM = "program"
    HAND = "hand"
    DEFAULT = "default"
    """umo itself: a reset, a lapsed command, an interlock."""


class Event(NamedTuple):
    """A guard acted: when (s on the cycle's clock), on which actuator, why."""

    time: float
    path: str
    text: str


@dataclass
class Command:
    """What is commanded of one guarded actuator, and what limits it."""

    slot: int
    default: float
    expires: float | None
    """s without a write after which the default is sent."""
    slew_rate: float | None
    """Units per s."""
    target: float
    """What was last accepted from the source."""
    source: Source = Source.DEFAULT
    written: float | None = None
    """When that was, s on the cycle's clock; None once it has lapsed."""
    inhibitors: list[Inhibition] = field(default_factory=list)
    """The interlocks that name this actuator."""
    unsent: bool = False
    """The default is to be sent and was not taken yet: it is tried again every period."""
    step: float = 0.0
    """Where the rate has brought it."""
    slewed: float = 0.0
    """When it last made a step."""
    resetting: bool = True

    @property
    def reason(self) -> str | None:
        """Why nothing but the default is sent now."""
        return next((each.reason for each in self.inhibitors if each.reason is not None), None)

    def admits(self, value: float, path: str) -> bool:
        """Whether a value may be taken now; Interlocked where an interlock is declared to stop the program."""
        if value == self.default:
            return True
        for each in self.inhibitors:
            if each.reason is not None:
                if each.interlock.effect == "stop":
                    raise Interlocked(path, each.reason)
                return False
        return True

    def rest(self, now: float) -> None:
        """At the default: after connecting, and with a reset, which passes over every guard."""
        self.target = self.step = self.default
        self.source, self.written = Source.DEFAULT, None
        self.resetting, self.slewed = True, now


@dataclass
class Inhibition:
    """One interlock at work."""

    interlock: Interlock
    slots: list[int]
    """What it forbids, in stop order."""
    reason: str | None = None
    """Why it inhibits now, None if it does not."""
    held: bool = False
    """Whether its condition held when it was last asked."""

    def ask(self) -> bool:
        """Ask the condition; True when it has just begun to inhibit."""
        before = self.reason
        found = _reason(self.interlock)
        self.held = found is not None
        self.reason = found if found is not None else before if self.interlock.latched else None
        return before is None and found is not None

    def acknowledge(self) -> None:
        if not self.held:
            self.reason = None


class Commands:
    """The command stage of one connected machine."""

    def __init__(self, root: Compound, image: Image) -> None:
        self._image = image
        self.events: deque[Event] = deque(maxlen=EVENTS)
        """The last thousand."""
        order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        self._inhibitions = [_inhibition(interlock, image, order) for interlock in interlocks_of(root)]
        forbidden = {slot for each in self._inhibitions for slot in each.slots}
        items = ((image.slot_of[id(item)], item) for item in root.atoms())  # as declared
        guarded = [(slot, item) for slot, item in items if slot in forbidden or _is_guarded(item)]
        self.by_slot = {slot: _command(slot, item, image.clock.now) for slot, item in guarded}
        for each in self._inhibitions:
            for slot in each.slots:
                self.by_slot[slot].inhibitors.append(each)
        self._expiring = [command for command in self.by_slot.values() if command.expires is not None]
        self.slewing = [command for command in self.by_slot.values() if command.slew_rate is not None]

    # From the source -----------------------------------------------------------------------------------

    def take(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """A value within the range was written; whether the image takes it. False: inhibited."""
        command = self.by_slot.get(slot)
        if command is None:
            return True
        if not command.admits(value, self._image.items[slot].path):
            return False
        command.target, command.source = value, source
        command.written = self._image.clock.now
        command.unsent = False
        return True

    def inhibited(self, slot: int) -> str | None:
        command = self.by_slot.get(slot)
        return None if command is None else command.reason

    def acknowledge(self, slots: Iterable[int]) -> bool:
        """Free what latched interlocks inhibit though their conditions have gone; whether all is free now."""
        commands = [self.by_slot[slot] for slot in slots if slot in self.by_slot]
        for command in commands:
            for each in command.inhibitors:
                each.acknowledge()
        return all(command.reason is None for command in commands)

    def rest(self, slot: int) -> None:
        """The actuator is being reset."""
        if slot in self.by_slot:
            self.by_slot[slot].rest(self._image.clock.now)

    # Each period ---------------------------------------------------------------------------------------

    def evaluate(self) -> None:
        """Interlocks, then expiries, then what could not be sent before; after `sample`. DriverError if a device did
        not take its default."""
        if not self.by_slot:
            return
        retry = [command.slot for command in self.by_slot.values() if command.unsent]
        failures = self._reset(retry)
        for each in self._inhibitions:
            if each.ask():
                for slot in each.slots:
                    self._happened(slot, f"reset: {each.reason}", Kind.INTERLOCKED)
                failures += self._reset(each.slots)
        for command in self._expiring:
            if self._has_expired(command):
                self._happened(command.slot, f"not written for {command.expires:g} s: to its default", Kind.EXPIRED)
                failures += self._lapse(command)
        if failures:
            raise DriverError("could not be reset", failures)

    def _reset(self, slots: list[int]) -> list[Failure]:
        """The driver's reset for each; what an asynchronous actuator did not take is tried again every period, as the
        next `update` does for the synchronous ones."""
        failures = []
        for slot, failure in self._image.reset_each(slots):
            self.by_slot[slot].unsent = failure is not None and not self._image.items[slot].synchronous
            failures += [failure] if failure else []
        return failures

    def _has_expired(self, command: Command) -> bool:
        if command.written is None or command.expires is None:
            return False
        return self._image.clock.now - command.written >= command.expires - A_TICK

    def _lapse(self, command: Command) -> list[Failure]:
        """The default as if written: sent with `update`, or asynchronous at once."""
        command.target, command.source, command.written = command.default, Source.DEFAULT, None
        self._image.set_default(command.slot)
        if self._image.items[command.slot].synchronous:
            return []
        failures = self._image.try_send(command.slot)
        command.unsent = bool(failures)
        return failures

    def slew(self, slots: Iterable[int] | None = None) -> None:
        """Pending becomes what the rate allows in this period, from what the hardware last accepted.

        One step a period, however often this is called. A reset that the device did not take is made up whole.
        """
        for command in self.slewing:
            if slots is None or command.slot in slots:
                self._slew(command)

    def _slew(self, command: Command) -> None:
        image, slot, now = self._image, command.slot, self._image.clock.now
        accepted = image.values[slot]
        if command.resetting and accepted != command.default:
            command.step, command.slewed = command.default, now
        elif now > command.slewed:
            assert command.slew_rate is not None
            step = command.slew_rate * (image.clock.dt or now - command.slewed)
            command.step = _towards(command.target, accepted, step)
            command.resetting, command.slewed = False, now
        image.pending[slot] = command.step
        image.pending_raws[slot] = image.wires[slot].raw(command.step)

    def _happened(self, slot: int, text: str, kind: Kind) -> None:
        event = Event(self._image.clock.now, self._image.items[slot].path, text)
        self.events.append(event)
        self._image.transfer.note(slot, kind)
        log.warning("%s %s", event.path, event.text)


def _command(slot: int, item: Atomic, now: float) -> Command:
    assert isinstance(item, BinaryActuator | DigitalActuator)
    default = item._default_value()
    rate = item._slew_rate if isinstance(item, DigitalActuator) else None
    return Command(slot, default, item._expires, rate, target=default, step=default, slewed=now)


def _inhibition(interlock: Interlock, image: Image, order: list[int]) -> Inhibition:
    slots = {image.slot_of[id(item)] for item in interlock.actuators()}
    return Inhibition(interlock, [slot for slot in order if slot in slots])


def _towards(target: float, start: float, step: float) -> float:
    """A step nearer to the target; there, when no more than a step is left but for rounding."""
    left = target - start
    return target if abs(left) <= step * (1 + 1e-9) else start + copysign(step, left)


def _is_guarded(item: Atomic) -> bool:
    if isinstance(item, DigitalActuator):
        return item._expires is not None or item._slew_rate is not None
    return isinstance(item, BinaryActuator) and item._expires is not None


def _reason(interlock: Interlock) -> str | None:
    """Why it inhibits now, None if it does not. A condition that cannot be evaluated counts as true."""
    try:
        holds: Any = interlock.condition()
        if not isinstance(holds, bool | np.bool_):  # None, for want of a return, would never forbid
            raise TypeError(f"{holds!r} is neither True nor False")
        return interlock.reason if holds else None
    except Exception as error:
        return f"{interlock.reason} (assumed: its condition could not be evaluated, {cause_of(error)})"
