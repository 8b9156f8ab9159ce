"""The command stage: checks every write to a guarded actuator before it reaches the process image.

    source, range, interlock, expiry, rate, then the image

The object itself checks the range first. A synchronous actuator without a guard, whose raw values match its range
exactly, writes to the image directly; then the command stage costs no time.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from math import copysign, inf
from typing import TYPE_CHECKING, Any

from umo.cycle.events import Event, Events
from umo.cycle.inhibition import Inhibition, inhibitions_of, latched, unevaluated
from umo.cycle.journal import Kind
from umo.cycle.stop_order import stop_sequence
from umo.errors import Interlocked
from umo.objects import Atomic, BinaryActuator, Compound, DigitalActuator

if TYPE_CHECKING:
    from umo.cycle.image import Image
    from umo.objects.scaling import FloatArray

log = logging.getLogger("umo")
FREE, IN_HAND = 0, 255
"""Bytes of `Commands.states`."""
A_TICK = 1e-9
"""Tolerance in s of a sum of periods (rounding)."""


def reason_of_hand(who: str) -> str:
    """Why the program cannot write an actuator that somebody has taken."""
    return f"taken by hand: {who}"


class Source(Enum):
    """The origin of a command."""

    PROGRAM = "program"
    HAND = "hand"
    DEFAULT = "default"
    """umo itself: a reset, an expired command, an interlock."""


@dataclass
class Command:
    """The command of one actuator and its limits."""

    slot: int
    path: str
    default: float
    synchronous: bool
    expires: float
    """Time in s without a write after which the default is sent; infinite: never."""
    slew_rate: float
    """Largest rate in units per s; infinite: not limited."""
    inhibitions: list[Inhibition]
    """The interlocks that name this actuator."""
    target: float
    """The value last accepted from the source."""
    source: Source = Source.DEFAULT
    written: float | None = None
    """Time of that write in s on the cycle's clock; None after it has expired."""
    step: float = 0.0
    """The value reached so far under the rate limit."""
    slewed: float = 0.0
    """Time of its last step."""
    resetting: bool = True
    hand: str = ""
    """The client that has taken the actuator: the program cannot write it meanwhile."""

    @property
    def guarded(self) -> bool:
        return bool(self.inhibitions) or self.expires < inf or self.slew_rate < inf

    @property
    def interlocked(self) -> str | None:
        """The reason of the interlock for which only the default may be sent."""
        return next((each.reason for each in self.inhibitions if each.reason is not None), None)

    @property
    def reason(self) -> str | None:
        """Why the program cannot write another value than the default."""
        return self.interlocked or (reason_of_hand(self.hand) if self.hand else None)

    def admits(self, value: float, source: Source) -> bool:
        """Whether a value may be taken now; Interlocked where an interlock is declared to stop the program."""
        if self.hand and source is not Source.HAND:
            return False
        if value == self.default:
            return True
        free = True
        for each in self.inhibitions:
            if each.reason is not None:
                if each.interlock.effect == "stop":
                    raise Interlocked(self.path, each.reason)
                free = False
        return free

    def take(self, value: float, source: Source, now: float) -> None:
        self.target, self.source, self.written = value, source, now

    def lapse(self) -> None:
        """The command has expired: the default is written; the rate limit applies to it."""
        self.target, self.source, self.written = self.default, Source.DEFAULT, None

    def rest(self, now: float) -> None:
        """The actuator is at its default: after connecting, and after a reset, which ignores all guards."""
        self.lapse()
        self.step = self.default
        self.resetting, self.slewed = True, now

    def has_expired(self, now: float) -> bool:
        return self.written is not None and not self.hand and now - self.written >= self.expires - A_TICK


class Commands:
    """The command stage of one connected machine."""

    def __init__(self, root: Compound, image: Image) -> None:
        self._image = image
        self.events = Events()
        self.unsent: set[int] = set()
        """Asynchronous actuators, guarded or not, whose default the device did not accept. The defaults of the others
        are sent by every `update`."""
        self._order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        self._inhibitions = inhibitions_of(root, image.slot_of, self._order)
        found = (self._command(item) for item in root.atoms() if isinstance(item, BinaryActuator | DigitalActuator))
        self.by_slot = {command.slot: command for command in found if command.guarded}
        """The guarded actuators, as declared."""
        commands = self.by_slot.values()
        self._expiring = [command for command in commands if command.expires < inf]
        self.slewing = [command for command in commands if command.slew_rate < inf]
        self._inhibiting: list[tuple[Inhibition, str]] = []
        """The interlocks that inhibit actuators, with their reasons, as last evaluated."""
        self._states: bytes | None = None
        """The last `states`; None after a change."""
        self._in_hand: set[int] = set()
        """The actuators that a hand has taken."""

    def _command(self, item: BinaryActuator[Any] | DigitalActuator) -> Command:
        slot, default = self._image.slot_of[id(item)], item._default_value()
        rate = item.slew_rate if isinstance(item, DigitalActuator) else None
        inhibitions = [each for each in self._inhibitions if slot in each.slots]
        command = Command(
            slot, item.path, default, item.synchronous, item.expires or inf, rate or inf, inhibitions, target=default
        )
        command.rest(self._image.clock.now)
        return command

    # From the source -----------------------------------------------------------------------------------

    def take(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """A value within the range was written; whether the image takes it. False: inhibited."""
        command = self.by_slot.get(slot)
        if command is not None:
            if not command.admits(value, source):
                return False
            command.take(value, source, self._image.clock.now)
        return True

    def take_many(self, slots: Sequence[int], values: FloatArray, source: Source = Source.PROGRAM) -> list[bool]:
        """The same for many at once, each with its answer; where it raises Interlocked, none was taken. Empty: all were
        taken, as no actuator of the machine is inhibited and none has an expiry or a rate to be recorded for."""
        if not (self._inhibiting or self._expiring or self.slewing or self._in_hand):
            return []
        commands = [self.by_slot.get(slot) for slot in slots]
        numbers = values.tolist()
        free = [each is None or each.admits(value, source) for each, value in zip(commands, numbers, strict=True)]
        for command, value, admitted in zip(commands, numbers, free, strict=True):
            if command is not None and admitted:
                command.take(value, source, self._image.clock.now)
        return free

    # By hand -------------------------------------------------------------------------------------------

    def hand_of(self, slot: int) -> str:
        """The client that has taken the actuator; empty: nobody."""
        command = self.by_slot.get(slot)
        return "" if command is None else command.hand

    def take_in_hand(self, slot: int, who: str) -> bool:
        """Give the actuator to this client alone. False while an interlock inhibits it."""
        command = self.by_slot.get(slot)
        if command is None:
            command = self.by_slot[slot] = self._command(self._image.items[slot])  # type: ignore[arg-type]
            self._image.guard(slot)
        if command.interlocked is not None:
            return False
        command.hand = who
        if slot not in self._in_hand:
            self._in_hand.add(slot)
            self._states = None
        return True

    def leave_hand(self, slot: int) -> None:
        """The program may write the actuator again. Its default is sent, within its rate."""
        command = self.by_slot[slot]
        command.hand = ""
        command.lapse()
        self._in_hand.discard(slot)
        self._states = None
        self._image.set_default(slot)
        if not command.synchronous:
            self._image.try_send(slot)
        if not command.guarded:
            del self.by_slot[slot]
            self._image.guard(slot)

    # ---------------------------------------------------------------------------------------------------

    def inhibited(self, slot: int) -> str | None:
        command = self.by_slot.get(slot)
        return None if command is None else command.reason

    def acknowledge(self, slots: Iterable[int]) -> bool:
        """Acknowledge latched interlocks whose conditions are false. True if no actuator is inhibited."""
        commands = [self.by_slot[slot] for slot in slots if slot in self.by_slot]
        for command in commands:
            for each in command.inhibitions:
                each.acknowledge()
        self._states = None
        return all(command.interlocked is None for command in commands)

    def interlocked(self, items: Iterable[Atomic]) -> list[str]:
        """The reasons of the interlocks that inhibit one of these, each once."""
        slots = {self._image.slot_of[id(item)] for item in items}
        return [reason for each, reason in self._inhibiting if each.reason is not None and slots & {*each.slots}]

    @property
    def states(self) -> bytes:
        """A byte for each slot: `FREE`, `IN_HAND`, or the number, from 1, of the reason for which it is inhibited."""
        if self._states is None:
            states = bytearray(len(self._image.items))
            numbers = {reason: number for number, reason in enumerate(self.reasons, 1)}
            for each in reversed(self._inhibitions):
                for slot in each.slots if each.reason is not None else ():
                    states[slot] = numbers.get(each.brief, len(numbers))
            for slot in self._in_hand:
                states[slot] = IN_HAND
            self._states = bytes(states)
        return self._states

    @property
    def reasons(self) -> list[str]:
        """The reasons of interlocks, each once, in the order of their numbers, those of conditions that cannot be
        evaluated, and those of latched interlocks whose condition is over; more than fit a byte share the last."""
        interlocks = [each.interlock for each in self._inhibitions]
        over = [latched(each) for each in interlocks if each.latched]
        found = list(dict.fromkeys([*(each.reason for each in interlocks), *map(unevaluated, interlocks), *over]))
        return found if len(found) < IN_HAND else [*found[: IN_HAND - 2], "one of many interlocks"]

    def failed(self, slot: int) -> None:
        """The device did not accept what is pending. A default is sent again, until it is accepted or another value is
        written."""
        item = self._image.items[slot]
        if isinstance(item, BinaryActuator | DigitalActuator) and not item.synchronous:
            at_default = self._image.pending[slot] == item._default_value()
            (self.unsent.add if at_default else self.unsent.discard)(slot)

    def rest(self, slot: int) -> None:
        """The actuator is being reset."""
        if slot in self.by_slot:
            self.by_slot[slot].rest(self._image.clock.now)

    # Each period ---------------------------------------------------------------------------------------

    def evaluate(self) -> None:
        """After `sample`: evaluate interlocks and expiries, and reset the actuators concerned in stop order.
        DriverError if a device did not accept its default; the reset is retried in every period."""
        if not (self.by_slot or self.unsent):
            return
        due = self.unsent | self._interlocked()
        due |= self._expired(due)
        if due:
            self._image.reset_some([slot for slot in self._order if slot in due])

    def _interlocked(self) -> set[int]:
        """The actuators that begin to be inhibited. All conditions are asked before anything is reset. Nothing latches
        before the first period: what is inhibited while the machine is being connected has not acted yet."""
        latch = self._image.clock.number > 0
        begun = [each for each in self._inhibitions if each.ask(latch)]
        if begun or self._inhibiting:
            inhibiting = [(each, each.reason) for each in self._inhibitions if each.reason is not None]
            if begun or inhibiting != self._inhibiting:
                self._inhibiting, self._states = inhibiting, None
        for each in begun:
            for slot in each.slots:
                self._knock_out(slot)
                self._happened(self.by_slot[slot], f"inhibited: {each.reason}", Kind.INTERLOCKED)
        return {slot for each in begun for slot in each.slots}

    def _knock_out(self, slot: int) -> None:
        """Take an actuator that is inhibited from its client: it does not start again by itself."""
        self.by_slot[slot].hand = ""
        self._in_hand.discard(slot)

    def _expired(self, due: set[int]) -> set[int]:
        """The asynchronous ones to be reset now; the default of the others is sent with `update`."""
        found = set()
        for command in self._expiring:
            if command.slot not in due and command.has_expired(self._image.clock.now):
                self._happened(
                    command,
                    f"command expired: not written for {command.expires:g} s, default sent",
                    Kind.EXPIRED,
                )
                if command.synchronous:
                    command.lapse()
                    self._image.set_default(command.slot)
                else:
                    found.add(command.slot)
        return found

    def expire(self) -> None:
        """Before outputs are sent that have waited for the tick: the default in the place of an expired command."""
        self._expired({command.slot for command in self._expiring if not command.synchronous})

    def slew(self, slots: Iterable[int] | None = None) -> None:
        """Before a transfer: pending becomes what the rate allows in this period, from what the hardware last accepted.
        One step per period, even if called several times. A reset that failed is retried without the limit."""
        for command in self.slewing:
            if slots is None or command.slot in slots:
                self._slew(command)

    def _slew(self, command: Command) -> None:
        image, slot, now = self._image, command.slot, self._image.clock.now
        accepted = image.values[slot]
        if command.resetting and accepted != command.default:
            command.step, command.slewed = command.default, now
        elif now > command.slewed:
            step = command.slew_rate * (image.clock.dt or now - command.slewed)
            command.step = _towards(command.target, accepted, step)
            command.resetting, command.slewed = False, now
        image.pending[slot] = command.step
        image.pending_raws[slot] = image.wires[slot].raw(command.step)

    def aim(self) -> None:
        """After a transfer: pending is again what was written."""
        for command in self.slewing:
            self._image.pending[command.slot] = command.target

    def _happened(self, command: Command, text: str, kind: Kind) -> None:
        self.events.add(Event(self._image.clock.now, command.path, text))
        self._image.transfer.note(command.slot, kind)
        log.warning("%s %s", command.path, text)


def _towards(target: float, start: float, step: float) -> float:
    """A step nearer to the target; there, when no more than a step is left but for rounding."""
    left = target - start
    return target if abs(left) <= step * (1 + 1e-9) else start + copysign(step, left)
