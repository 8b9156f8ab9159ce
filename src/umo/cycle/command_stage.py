"""The command stage: checks every write to a guarded actuator before it reaches the process image.

    source, range, interlock, expiry, then the image

The object itself checks the range first. Only writes to actuators that are marked in the column `restrictions` come
here; the column belongs to the command stage. All other writes go straight into the image. The image limits the rate.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from math import inf
from typing import Any

import numpy as np

from umo.cycle.columns import ASKED, TAKEN_BY_CLIENT, Source
from umo.cycle.events import Event, Paths, of_several
from umo.cycle.image import Image, ToDefault
from umo.cycle.inhibition import Inhibition, inhibitions_of, latched, unevaluated
from umo.cycle.journal import Kind
from umo.errors import Failure, Interlocked
from umo.objects import Actuator, Atomic, Compound, atoms
from umo.objects.claims import TAKEN, Claim, Rank
from umo.objects.scaling import FloatArray
from umo.objects.stop_order import stop_sequence

ONE_BY_ONE = 64
"""Number of actuators from which on the column `restrictions` is set as a whole."""
A_TICK = 1e-9
"""Tolerance in s of a sum of periods (rounding)."""


def reason_of_client(who: str) -> str:
    """Why the program cannot write an actuator that somebody has taken."""
    return f"{TAKEN}{who}"


@dataclass
class Command:
    """The command of one actuator and its limits."""

    slot: int
    path: str
    default: float
    synchronous: bool
    expires: float
    """Time in s without a write after which the default is sent; infinite: never."""
    interlocks: list[Inhibition]
    """The interlocks that name this actuator."""
    faults: list[Inhibition]
    """The faults of its equipment."""
    written: float | None = None
    """Time of the last write that was admitted, in s on the cycle's clock; None after it has expired."""
    client: str = ""
    """The client that has taken the actuator: the program cannot write it meanwhile."""

    @property
    def interlocked(self) -> str | None:
        """The reason of the fault or interlock for which only the default may be sent."""
        both = chain(self.faults, self.interlocks)
        return next((each.reason for each in both if each.reason is not None), None)

    @property
    def rank(self) -> Rank:
        """Who has it."""
        if self.in_fault:
            return Rank.FAULT
        if any(each.reason is not None for each in self.interlocks):
            return Rank.INTERLOCK
        return Rank.CLIENT if self.client else Rank.PROGRAM

    @property
    def in_fault(self) -> bool:
        """Whether its equipment is in fault."""
        return any(each.held for each in self.faults)

    @property
    def reason(self) -> str | None:
        """Why the program cannot write another value than the default."""
        return self.interlocked or (reason_of_client(self.client) if self.client else None)

    def admits(self, value: float, source: Source) -> bool:
        """Whether a value may be taken now; Interlocked where an interlock is declared to stop the program."""
        if self.client and source is not Source.CLIENT:
            return False
        if value == self.default:
            return True
        for fault in self.faults:
            if fault.held:  # before any interlock: equipment in fault refuses, and raises nothing
                return False
        free = True
        for each in self.interlocks:
            if each.reason is not None:
                if each.interlock.effect == "stop":
                    raise Interlocked(self.path, each.reason)
                free = False
        return free

    def has_expired(self, now: float) -> bool:
        return self.written is not None and not self.client and now - self.written >= self.expires - A_TICK


WriteWatch = Callable[[int, float, str, bool], object]
"""A function that is told of a write: the slot, the value, the source, whether it was taken."""


class CommandStage:
    """The command stage of one connected machine."""

    def __init__(self, root: Compound, image: Image) -> None:
        self._image = image
        self.events = image.events
        self.order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        """The actuators in stop order."""
        self.place = {slot: number for number, slot in enumerate(self.order)}
        """The place of each in this order."""
        self.inhibitions = inhibitions_of(root, image.slot_of, self.order)
        """The interlocks, as declared."""
        self._interlocks_of = _by_slot(self.inhibitions)
        self._faults: list[Inhibition] = []
        """The inhibitions by faults of equipment: no condition is asked for these."""
        self._faults_of = _by_slot(self._faults)
        self._of_equipment: dict[int, Command] = {}
        """The actuators of equipment: made beforehand, for its first fault."""
        found = (self._command(item) for item in atoms(root) if isinstance(item, Actuator))
        self.by_slot = {command.slot: command for command in found if command.interlocks or command.expires < inf}
        """The guarded actuators, as declared, and those that were taken by a client or inhibited by a fault since."""
        commands = self.by_slot.values()
        self._expiring = [command for command in commands if command.expires < inf]
        self._inhibiting: list[tuple[Inhibition, str]] = []
        """The interlocks that inhibit actuators, with their reasons, as last evaluated."""
        self._untold: dict[tuple[int, Inhibition], None] = {}
        """The slots and interlocks that have begun to inhibit them during a fault of their equipment."""
        self._taken_by_clients: set[int] = set()
        """The actuators that a client has taken."""
        self.left: dict[object, dict[int, float]] = {}
        """What waiting work has left of its actuators, by slot, for each that lets work wait. A fault of equipment ends
        the work in it, and with it what it has left."""
        self._watching: list[WriteWatch] = []
        self.noted: set[int] | None = None
        """The actuators that were written since `note_writes`; None: they are not noted."""
        self._numbers: dict[str, int] = {}
        asked = (slot for slot in self.order if image.deliveries[slot].at_once)
        self._unrestricted = np.zeros(len(image.items), np.uint8)
        """The column `restrictions` while nothing is inhibited and no client has taken an actuator."""
        self._unrestricted[[*asked, *(command.slot for command in self._expiring)]] = ASKED
        self.know([])

    def _command(self, item: Actuator) -> Command:
        slot, default = self._image.slot_of[id(item)], item._default_value()
        interlocks, faults = self._interlocks_of.get(slot, []), self._faults_of.get(slot, [])
        return Command(slot, item.path, default, item.synchronous, item.expires or inf, interlocks, faults)

    # From the source -----------------------------------------------------------------------------------

    def accept(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """A value within the range was written; whether the image takes it. False: inhibited."""
        if self.noted is not None:
            self.noted.add(slot)
        command, taken = self.by_slot.get(slot), False
        try:
            taken = command is None or command.admits(value, source)
        finally:
            for watch in self._watching:
                watch(slot, value, source.value, taken)
        if command is not None and taken:
            command.written = self._image.clock.now
        return taken

    def accept_many(self, slots: Sequence[int], values: FloatArray) -> list[bool]:
        """The same for many at once, each with its answer; where it raises Interlocked, none was taken."""
        if self.noted is not None:
            self.noted.update(slots)
        commands = [self.by_slot.get(slot) for slot in slots]
        numbers = values.tolist()
        free = [
            each is None or each.admits(value, Source.PROGRAM) for each, value in zip(commands, numbers, strict=True)
        ]
        for watch in self._watching:
            for slot, value, taken in zip(slots, numbers, free, strict=True):
                watch(slot, value, Source.PROGRAM.value, taken)
        for command, admitted in zip(commands, free, strict=True):
            if command is not None and admitted:
                command.written = self._image.clock.now
        return free

    # Clients -------------------------------------------------------------------------------------------

    def client_of(self, slot: int) -> str:
        """The client that has taken the actuator; empty: nobody."""
        command = self.by_slot.get(slot)
        return "" if command is None else command.client

    def take_for_client(self, slot: int, who: str) -> bool:
        """Give the actuator to this client alone. False while it is inhibited."""
        command = self._known(slot)
        if command.interlocked is not None:
            return False
        command.client = who
        self._taken_by_clients.add(slot)
        self._restrict_one(command)
        return True

    def release_from_client(self, slots: Sequence[int]) -> None:
        """The program may write these actuators again. Their defaults are sent, within their rates."""
        for slot in slots:
            self.by_slot[slot].client = ""
        self._taken_by_clients.difference_update(slots)
        self._restrict(slots)
        self._image.settle(slots, ToDefault.SEND)

    def end_client(self, slot: int) -> None:
        """The actuator is at its default: a client that had taken it has it no longer, which the client is told."""
        if slot in self._taken_by_clients:
            self._taken_by_clients.discard(slot)
            self.by_slot[slot].client = ""
            self._restrict_one(self.by_slot[slot])

    def go_on(self, left: Mapping[int, float]) -> None:
        """Work goes on: what it has left of these actuators is written again. What is not taken is told."""
        if refused := [slot for slot, value in left.items() if not self._goes_on(slot, value)]:
            self.events.add(partial(_not_restored, self._image.clock.now, self._image.items, refused), logged=True)

    def _goes_on(self, slot: int, value: float) -> bool:
        try:
            return self._image.go_on(slot, value)
        except Interlocked:  # whoever goes on has not written this: it is told
            return False

    def _known(self, slot: int) -> Command:
        """The command of an actuator, also of one without a guard."""
        command = self.by_slot.get(slot)
        if command is None:
            command = self._of_equipment.get(slot) or self._command(self._image.items[slot])  # type: ignore[arg-type]
            self.by_slot[slot] = command
        return command

    # Faults of equipment -------------------------------------------------------------------------------

    def know(self, faults: Sequence[Inhibition]) -> None:
        """The inhibitions that `inhibit` and `free` will be given; before the first period."""
        self._faults, self._faults_of = list(faults), _by_slot(faults)
        for command in self.by_slot.values():
            command.faults = self._faults_of.get(command.slot, [])
        items: Any = self._image.items
        self._of_equipment = {slot: self._command(items[slot]) for slot in self._faults_of if slot not in self.by_slot}
        self._numbers = {reason: number for number, reason in enumerate(self.reasons, 1)}
        self._restrict()

    def hold(self, fault: Inhibition) -> None:
        """Only the defaults of its actuators may be sent from now on, whoever has taken them: no fault around them
        holds them yet."""
        fault.held, fault.reason = True, fault.interlock.reason
        number = self._numbers.get(fault.reason, len(self._numbers))
        known, restrictions, any_taken = self.by_slot, self._image.restrictions, bool(self._taken_by_clients)
        for slot in fault.slots:
            if slot not in known:
                self._known(slot)
            elif any_taken:
                known[slot].client = ""
            restrictions[slot] = number
        if any_taken:
            self._taken_by_clients.difference_update(fault.slots)
        for left in self.left.values():
            for slot in left.keys() & fault.slots:
                del left[slot]

    def inhibit(self, faults: Sequence[Inhibition]) -> dict[int, Failure]:
        """The actuators of these, which are held, go to their defaults in stop order; those that failed, by slot."""
        slots = sorted({slot for fault in faults for slot in fault.slots}, key=self.place.__getitem__)
        self._image.transfer.note_each(slots, Kind.INTERLOCKED)
        return self._image.settle(slots, ToDefault.RESET)

    def free(self, faults: Sequence[Inhibition]) -> None:
        """Their actuators may be written again, unless an interlock inhibits them: one that began to do so during the
        fault is told now."""
        for fault in faults:
            fault.held, fault.reason = False, None
        self._restrict([slot for fault in faults for slot in fault.slots])
        begun: dict[Inhibition, list[int]] = {}
        for slot, each in [key for key in self._untold if not self.by_slot[key[0]].in_fault]:
            del self._untold[slot, each]
            if each.reason is not None:
                begun.setdefault(each, []).append(slot)
        for each, slots in begun.items():
            self._image.transfer.note_each(slots, Kind.INTERLOCKED)
            self._tell_inhibited(slots, each)

    # ---------------------------------------------------------------------------------------------------

    def claim(self, slot: int) -> Claim:
        """Who drives an actuator."""
        command = self.by_slot.get(slot)
        return Claim(Rank.PROGRAM) if command is None else Claim(command.rank, command.reason or "")

    def inhibited(self, slot: int) -> str | None:
        command = self.by_slot.get(slot)
        return None if command is None else command.reason

    def acknowledge(self, slots: frozenset[int]) -> bool:
        """Acknowledge latched interlocks of these actuators whose conditions are false. True if none of them is
        inhibited."""
        for each in self._inhibiting_some(slots, self.inhibitions):
            each.acknowledge()
        self._restrict()
        return not self._inhibiting_some(slots, [*self.inhibitions, *self._faults])

    def inhibiting(self, slots: frozenset[int], *, latched: bool = False) -> list[str]:
        """The reasons of the interlocks that inhibit one of these, each once; `latched`: of those that latch."""
        found = self._inhibiting_some(slots, self.inhibitions)
        asked = (each for each in found if each.interlock.latched or not latched)
        return list(dict.fromkeys(each.reason for each in asked if each.reason))

    def _inhibiting_some(self, slots: frozenset[int], among: Iterable[Inhibition]) -> list[Inhibition]:
        """Those that inhibit one of these actuators now."""
        return [each for each in among if each.reason is not None and not slots.isdisjoint(each.slots)]

    def _restrict(self, slots: Sequence[int] | None = None) -> None:
        """Set the column `restrictions` of these actuators; None: of all."""
        if slots is not None and len(slots) < ONE_BY_ONE:
            for slot in slots:
                self._restrict_one(self._known(slot))
            return
        found = self._unrestricted.copy()
        if self._asks_all:
            found[self.order] = ASKED
        for each in reversed([*self._faults, *self.inhibitions]):
            if each.reason is not None:
                found[each.slots] = self._numbers.get(each.brief, len(self._numbers))
        found[[*self._taken_by_clients]] = TAKEN_BY_CLIENT
        self._image.columns.restrictions[:] = found

    def _restrict_one(self, command: Command) -> None:
        """The same of one actuator."""
        slot, both = command.slot, chain(command.faults, command.interlocks)
        each = next((each for each in both if each.reason is not None), None)
        if slot in self._taken_by_clients:
            found = TAKEN_BY_CLIENT
        elif each is not None:
            found = self._numbers.get(each.brief, len(self._numbers))
        else:
            found = ASKED if self._asks_all else int(self._unrestricted[slot])
        self._image.restrictions[slot] = found

    @property
    def _asks_all(self) -> bool:
        """Whether writes of free actuators pass this stage too."""
        return self.noted is not None or bool(self._watching)

    def note_writes(self, yes: bool) -> None:
        """Note in `noted` which actuators are written, by whomever; or no longer."""
        self.noted = set() if yes else None
        self._restrict()

    @property
    def reasons(self) -> list[str]:
        """The reasons of interlocks, each once, in the order of their numbers, those of conditions that cannot be
        evaluated, those of latched interlocks whose condition is over, and those of faults of equipment; more than fit
        a byte share the last."""
        interlocks = [each.interlock for each in self.inhibitions]
        over = [latched(each) for each in interlocks if each.latched]
        faults = (each.interlock.reason for each in self._faults)
        declared = (each.reason for each in interlocks)
        found = list(dict.fromkeys([*declared, *map(unevaluated, interlocks), *over, *faults]))
        return found if len(found) < ASKED else [*found[: ASKED - 2], "one of many interlocks"]

    def rest(self, slot: int) -> None:
        """The actuator goes to its default."""
        if slot in self.by_slot:
            self.by_slot[slot].written = None
        for watch in self._watching:
            watch(slot, float(self._image.scales.defaults[slot]), Source.DEFAULT.value, True)

    def watch(self, call: WriteWatch) -> None:
        """From now on this function is told of each write and each default that is sent: its slot, its value, the
        source ("program", "client", "default"), and whether it was taken. Every write passes this stage."""
        self._watching.append(call)
        self._restrict()

    # Each period ---------------------------------------------------------------------------------------

    def evaluate(self) -> None:
        """After `sample`: evaluate interlocks and expiries, and reset the actuators concerned in stop order.
        DriverError if a device did not accept its default; the reset is retried in every period."""
        if not (self.by_slot or self._image.owed):
            return
        due = self._image.owed | self._interlocked()
        due |= self._expired(due)
        if due:
            self._image.reset_some([slot for slot in self.order if slot in due])

    def _interlocked(self) -> set[int]:
        """The actuators that begin to be inhibited. All conditions are asked before anything is reset. Nothing latches
        before the first period: what is inhibited while the machine is being connected has not acted yet."""
        latch = self._image.clock.number > 0
        begun = [each for each in self.inhibitions if each.ask(latch)]
        if begun or self._inhibiting:
            inhibiting = [(each, each.reason) for each in self.inhibitions if each.reason is not None]
            if begun or inhibiting != self._inhibiting:
                self._inhibiting = inhibiting
                self._taken_by_clients.difference_update(*(each.slots for each in begun))
                self._restrict()
        inhibited: list[int] = []
        any_fault = bool(begun) and any(fault.held for fault in self._faults)
        for each in begun:
            for slot in each.slots:
                self.by_slot[slot].client = ""  # it does not start again by itself
            in_fault = [slot for slot in each.slots if self.by_slot[slot].in_fault] if any_fault else ()
            self._untold |= {(slot, each): None for slot in in_fault}
            if slots := [slot for slot in each.slots if slot not in in_fault] if in_fault else each.slots:
                inhibited += slots
                self._tell_inhibited(slots, each)
        self._image.transfer.note_each(inhibited, Kind.INTERLOCKED)
        return {slot for each in begun for slot in each.slots}

    def _tell_inhibited(self, slots: Sequence[int], each: Inhibition) -> None:
        """One interlock inhibits these."""
        waits = each.interlock.latched and each.held  # its reason says so itself once its condition is false
        what = "inhibited until acknowledged" if waits else "inhibited"
        event = partial(_inhibited, self._image.clock.now, self._image.items, slots, what, str(each.reason))
        self.events.add(event, logged=True)

    def _expired(self, due: Container[int]) -> set[int]:
        """The asynchronous ones to be reset now; the default of the others is sent with `update`."""
        sent, found = list[int](), set[int]()
        told: dict[float, list[int]] = {}
        now, pending = self._image.clock.now, self._image.pending
        for command in self._expiring:
            slot = command.slot
            if slot not in due and command.has_expired(now):
                if pending[slot] != command.default:  # where it is, nothing happens that is to be told
                    told.setdefault(command.expires, []).append(slot)
                if command.synchronous:
                    sent.append(slot)
                else:
                    found.add(slot)
        for expires, slots in told.items():
            self._image.transfer.note_each(slots, Kind.EXPIRED)
            self.events.add(partial(_commands_expired, now, self._image.items, slots, expires), logged=True)
        if sent:
            self._image.settle(sent, ToDefault.SEND)
        return found

    def expire(self) -> None:
        """Before outputs are sent that have waited for the tick: the default in the place of an expired command."""
        self._expired({command.slot for command in self._expiring if not command.synchronous})


def _inhibited(now: float, items: Sequence[Atomic], slots: Sequence[int], what: str, reason: str) -> Event:
    paths = Paths(items, slots)
    return of_several(now, paths, f"{what}: {reason}", f"{reason}: {len(paths):,} actuators {what}")


def _not_restored(now: float, items: Sequence[Atomic], slots: Sequence[int]) -> Event:
    paths = Paths(items, slots)
    return of_several(now, paths, "not restored: it is inhibited", f"{len(paths):,} not restored: they are inhibited")


def _commands_expired(now: float, items: Sequence[Atomic], slots: Sequence[int], expires: float) -> Event:
    paths = Paths(items, slots)
    alone = f"command expired: not written for {expires:g} s, default sent"
    return of_several(
        now, paths, alone, f"{len(paths):,} commands expired: not written for {expires:g} s, defaults sent"
    )


def _by_slot(inhibitions: Iterable[Inhibition]) -> dict[int, list[Inhibition]]:
    """Those that name each actuator, as declared."""
    found: dict[int, list[Inhibition]] = {}
    for each in inhibitions:
        for slot in each.slots:
            found.setdefault(slot, []).append(each)
    return found
