"""The claims of a machine: who drives each actuator (docs/decisions/0094-who-drives-an-output.md).

Each actuator is in one of three conditions: a fault of its equipment or an interlock keeps it at its default; only a
client may write it; or the program may write it. The column `restrictions` shows this to all writers. Only this table
sets the column.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from umo.cycle.columns import ASKED, TAKEN_BY_CLIENT, Source
from umo.cycle.image import Image
from umo.cycle.inhibition import Inhibition, inhibitions_of, latched, unevaluated
from umo.cycle.journal import Kind
from umo.cycle.to_defaults import ToDefault
from umo.duration import TIME_TOLERANCE
from umo.errors import Failure, Interlocked
from umo.objects import Actuator, Compound, atoms
from umo.objects.claims import TAKEN, Claim, Rank
from umo.objects.stop_order import stop_sequence

ONE_BY_ONE = 64
"""The least number of changed actuators for which the whole column `restrictions` is computed at once."""


def reason_of_client(who: str) -> str:
    """Return the reason why the program cannot write an actuator that a client has taken."""
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
    """The faults of the equipment around this actuator."""
    written: float | None = None
    """The time of the last admitted write in s on the cycle's clock; None after this write has expired."""
    client: str = ""
    """The client that has taken the actuator, so that the program cannot write it."""

    @property
    def inhibition(self) -> Inhibition | None:
        """The fault or interlock because of which only the default may be sent."""
        for each in self.faults:
            if each.reason is not None:
                return each
        for each in self.interlocks:
            if each.reason is not None:
                return each
        return None

    @property
    def interlocked(self) -> str | None:
        """The reason of the inhibition, or None."""
        return None if (found := self.inhibition) is None else found.reason

    @property
    def rank(self) -> Rank:
        """The rank that now decides about the actuator."""
        if any(each.held for each in self.faults):
            return Rank.FAULT
        if any(each.reason is not None for each in self.interlocks):
            return Rank.INTERLOCK
        return Rank.CLIENT if self.client else Rank.PROGRAM

    @property
    def reason(self) -> str | None:
        """The reason why the program may write no value except the default."""
        return self.interlocked or (reason_of_client(self.client) if self.client else None)

    def admits(self, value: float, source: Source) -> bool:
        """Return True if a value may be taken now; raises Interlocked if an interlock with the effect "stop" inhibits
        it."""
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
        return self.written is not None and not self.client and now - self.written >= self.expires - TIME_TOLERANCE


class Claims:
    """The claims of one machine."""

    def __init__(self, root: Compound, image: Image) -> None:
        self._image = image
        self.order = [image.slot_of[id(item)] for item in stop_sequence(root)]
        """The guarded actuators in stop order."""
        self.place = {slot: number for number, slot in enumerate(self.order)}
        """The index of each actuator in this order."""
        self.inhibitions = inhibitions_of(root, image.slot_of, self.order)
        """The interlocks, as declared."""
        self._interlocks_of = _by_slot(self.inhibitions)
        self._faults: list[Inhibition] = []
        """The inhibitions by faults of equipment. They have no condition."""
        self._faults_of = _by_slot(self._faults)
        self._of_equipment: dict[int, Command] = {}
        """The actuators of each equipment, collected before its first fault."""
        found = (self._command(item) for item in atoms(root) if isinstance(item, Actuator))
        self.by_slot = {command.slot: command for command in found if command.interlocks or command.expires < inf}
        """The guarded actuators, as declared, and the actuators that a client has taken or a fault has inhibited
        since."""
        self._taken_by_clients: set[int] = set()
        """The actuators that a client has taken."""
        self.left: dict[object, dict[int, float]] = {}
        """The values that suspended work last wrote to its actuators, by slot, for each part in which work is
        suspended. A fault of equipment ends the work in the equipment and removes these values."""
        self._asks_all = False
        """True if writes to free actuators pass the command stage, too."""
        self._numbers: dict[str, int] = {}
        asked = (slot for slot in self.order if image.deliveries[slot].at_once)
        expiring = (slot for slot, command in self.by_slot.items() if command.expires < inf)
        self._unrestricted = np.zeros(len(image.items), np.uint8)
        """The column `restrictions` while nothing is inhibited and no client has taken an actuator."""
        self._unrestricted[[*asked, *expiring]] = ASKED
        self.know([])

    def _command(self, item: Actuator) -> Command:
        slot, default = self._image.slot_of[id(item)], item._default_value()
        interlocks, faults = self._interlocks_of.get(slot, []), self._faults_of.get(slot, [])
        return Command(slot, item.path, default, item.synchronous, item.expires or inf, interlocks, faults)

    def _known(self, slot: int) -> Command:
        """Return the command of an actuator, even if the actuator has no guard."""
        command = self.by_slot.get(slot)
        if command is None:
            command = self._of_equipment.get(slot) or self._command(self._image.items[slot])  # type: ignore[arg-type]
            self.by_slot[slot] = command
        return command

    # Who has it ----------------------------------------------------------------------------------------

    def claim(self, slot: int) -> Claim:
        """Return the claim on an actuator."""
        command = self.by_slot.get(slot)
        return Claim(Rank.PROGRAM) if command is None else Claim(command.rank, command.reason or "")

    def inhibited(self, slot: int) -> str | None:
        command = self.by_slot.get(slot)
        return None if command is None else command.reason

    def acknowledge(self, slots: frozenset[int]) -> bool:
        """Acknowledge latched interlocks of these actuators whose conditions are false. Return True if none of them is
        inhibited."""
        for each in self._inhibiting_some(slots, self.inhibitions):
            each.acknowledge()
        self._restrict()
        return not self._inhibiting_some(slots, [*self.inhibitions, *self._faults])

    def inhibiting(self, slots: frozenset[int], *, latched: bool = False) -> list[str]:
        """Return the reasons of the interlocks that inhibit one of these actuators, each once. With `latched`, return
        only the reasons of latched interlocks."""
        found = self._inhibiting_some(slots, self.inhibitions)
        asked = (each for each in found if each.interlock.latched or not latched)
        return list(dict.fromkeys(each.reason for each in asked if each.reason))

    def _inhibiting_some(self, slots: frozenset[int], among: Iterable[Inhibition]) -> list[Inhibition]:
        """Return the inhibitions that inhibit one of these actuators now."""
        return [each for each in among if each.reason is not None and not slots.isdisjoint(each.slots)]

    # Clients -------------------------------------------------------------------------------------------

    def client_of(self, slot: int) -> str:
        """Return the client that has taken the actuator; empty if no client has."""
        command = self.by_slot.get(slot)
        return "" if command is None else command.client

    def take_for_client(self, slot: int, who: str) -> bool:
        """Give the actuator to this client alone. Return False while it is inhibited."""
        command = self._known(slot)
        if command.interlocked is not None:
            return False
        command.client = who
        self._taken_by_clients.add(slot)
        self._restrict_one(command)
        return True

    def release_from_client(self, slots: Sequence[int]) -> None:
        """Let the program write these actuators again. Their defaults are sent, within their rates."""
        for slot in slots:
            self.by_slot[slot].client = ""
        self._taken_by_clients.difference_update(slots)
        self._restrict(slots)
        self._image.settle(slots, ToDefault.SEND)

    def end_client(self, slot: int) -> None:
        """End the hold of a client on an actuator that is at its default, and notify the client."""
        if slot in self._taken_by_clients:
            self._taken_by_clients.discard(slot)
            self.by_slot[slot].client = ""
            self._restrict_one(self.by_slot[slot])

    # Interlocks and faults of equipment ----------------------------------------------------------------

    def interlocked(self, begun: Sequence[Inhibition]) -> None:
        """Update the claims after these interlocks have begun to inhibit, or after interlocks have ended. A client's
        hold on the actuators does not come back by itself."""
        for each in begun:
            self._taken_by_clients.difference_update(each.slots)
            for slot in each.slots:
                self.by_slot[slot].client = ""
        self._restrict()

    @property
    def any_fault(self) -> bool:
        """True if a fault keeps any actuator at its default."""
        return any(fault.held for fault in self._faults)

    def know(self, faults: Sequence[Inhibition]) -> None:
        """Set the inhibitions for later calls of `inhibit` and `free`; called before the first period."""
        self._faults, self._faults_of = list(faults), _by_slot(faults)
        for command in self.by_slot.values():
            command.faults = self._faults_of.get(command.slot, [])
        items: Any = self._image.items
        self._of_equipment = {slot: self._command(items[slot]) for slot in self._faults_of if slot not in self.by_slot}
        self._numbers = {reason: number for number, reason in enumerate(self.reasons, 1)}
        self._restrict()

    def hold(self, fault: Inhibition) -> None:
        """Allow only the defaults of the actuators of this inhibition from now on, even if a client has taken the
        actuators. No other fault may hold these actuators yet."""
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
        """Reset the actuators of these inhibitions, which must be held (`hold`), in stop order. Return the failures by
        slot."""
        slots = sorted({slot for fault in faults for slot in fault.slots}, key=self.place.__getitem__)
        self._image.transfer.note_each(slots, Kind.INTERLOCKED)
        return self._image.settle(slots, ToDefault.RESET)

    def free(self, faults: Sequence[Inhibition]) -> None:
        """Allow writes to the actuators of these inhibitions again, unless an interlock inhibits them."""
        for fault in faults:
            fault.held, fault.reason = False, None
        self._restrict([slot for fault in faults for slot in fault.slots])

    # The column `restrictions` -------------------------------------------------------------------------

    def ask_all(self, yes: bool) -> None:
        """Set whether the command stage checks every write."""
        self._asks_all = yes
        self._restrict()

    def _restrict(self, slots: Sequence[int] | None = None) -> None:
        """Set the column `restrictions` of these actuators; None means all."""
        if slots is not None and len(slots) < ONE_BY_ONE:
            for slot in slots:
                self._restrict_one(self._known(slot))
            return
        found = self._unrestricted.copy()
        if self._asks_all:
            found[self.order] = ASKED
        for each in reversed([*self._faults, *self.inhibitions]):
            if each.reason is not None:
                found[each.slots] = self._numbers.get(each.reason_key, len(self._numbers))
        found[[*self._taken_by_clients]] = TAKEN_BY_CLIENT
        self._image.columns.restrictions[:] = found

    def _restrict_one(self, command: Command) -> None:
        """Set the column of one actuator."""
        slot, each = command.slot, command.inhibition
        if slot in self._taken_by_clients:
            found = TAKEN_BY_CLIENT
        elif each is not None:
            found = self._numbers.get(each.reason_key, len(self._numbers))
        else:
            found = ASKED if self._asks_all else int(self._unrestricted[slot])
        self._image.restrictions[slot] = found

    @property
    def reasons(self) -> list[str]:
        """The reasons, each once, in the order of their numbers: of interlocks, of conditions that cannot be evaluated,
        of latched interlocks whose condition is over, and of faults of equipment. Reasons whose numbers do not fit a
        byte share the last number."""
        interlocks = [each.interlock for each in self.inhibitions]
        over = [latched(each) for each in interlocks if each.latched]
        faults = (each.interlock.reason for each in self._faults)
        declared = (each.reason for each in interlocks)
        found = list(dict.fromkeys([*declared, *map(unevaluated, interlocks), *over, *faults]))
        return found if len(found) < ASKED else [*found[: ASKED - 2], "one of many interlocks"]


def _by_slot(inhibitions: Iterable[Inhibition]) -> dict[int, list[Inhibition]]:
    """Return the inhibitions that name each actuator, as declared."""
    found: dict[int, list[Inhibition]] = {}
    for each in inhibitions:
        for slot in each.slots:
            found.setdefault(slot, []).append(each)
    return found
