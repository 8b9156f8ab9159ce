"""Equipment: parts of a machine whose failures do not end the run (the equipment module of ISA-88).

A failure of an object, a law, a started sequence or a motion belongs to the innermost equipment around it. While
equipment is in fault, its actuators are at their defaults, its sequences have ended, and its laws are not called. The
other parts of the machine continue. A failure that no declared equipment contains ends the run.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from operator import attrgetter
from typing import Any

from umo.cycle.claim_table import Claims
from umo.cycle.events import FAULT, FAULT_CLEARED, FAULT_PREFIX, Event
from umo.cycle.guards import Guards
from umo.cycle.image import Image, raise_failures
from umo.cycle.inhibition import Inhibition
from umo.cycle.sequences import Task
from umo.errors import DriverError, EquipmentFault, Failure, text_later
from umo.objects import Actuator, Atomic, Compound, Interlock, Node, Quality, atoms, walk
from umo.objects.keywords import IN_MANUAL
from umo.objects.node import outwards
from umo.objects.paths import is_within
from umo.objects.sensors import Sensor
from umo.text import in_a_line, some
from umo.user_code import is_interrupt

log = logging.getLogger("umo")

CLEANING_UP = "while cleaning up: "
"""The first words of the event about an error in a sequence or motion that a fault has ended."""


class EquipmentState(IntEnum):
    """The state of equipment. The numbers are stored in frames."""

    NORMAL = 0
    FAULT = 1


class Reason:
    """The reason of a fault as a function. Its text is made when the function is called."""

    __slots__ = ("_given", "_words")

    def __init__(self, given: str | Callable[[], str]) -> None:
        self._given, self._words = given, ""

    def __call__(self) -> str:
        if not self._words:
            given, self._given = self._given, ""
            self._words = in_a_line(given if isinstance(given, str) else given())
        return self._words


@dataclass(eq=False)
class Equipment:
    """One compound that is declared as equipment."""

    number: int
    """The index of the equipment among all equipment; outer equipment precedes inner equipment."""
    compound: Compound
    path: str
    slots: list[int]
    """The objects of the equipment: the actuators in stop order, then the sensors."""
    in_manual_only: bool
    """True if the equipment contains its failures in manual mode only."""
    inhibition: Inhibition | None
    """The inhibition that keeps the actuators at their defaults during a fault; None if the equipment has no
    actuators."""
    referenced: frozenset[int]
    """The sensors whose reference is lost when they are initialised."""
    nodes: tuple[int, ...]
    """The ids of the equipment's compound and of all objects below it."""
    in_fault: bool = False
    reason: Callable[[], str] = str
    """The reason of the fault. Its text is made when it is read. "" if the equipment is not in fault."""

    def describe(self) -> dict[str, Any]:
        """Return the equipment as plain data."""
        return {"path": self.path, "states": [state.name.lower() for state in EquipmentState]}

    @property
    def fault(self) -> str | None:
        """The reason of the equipment's fault, or None."""
        return self.reason() if self.in_fault else None

    def enter(self, reason: str | Callable[[], str]) -> None:
        """Record that the equipment enters a fault."""
        self.in_fault, self.reason = True, Reason(reason)

    def clear(self) -> None:
        """Record that the fault of the equipment is cleared."""
        self.in_fault, self.reason = False, str

    def error(self) -> EquipmentFault:
        """Return the error of the fault. Each call returns a new error, because an error that is raised again keeps the
        frames of each raise."""
        return EquipmentFault(self.path, self.reason)

    def error_of_this_fault(self) -> Callable[[], EquipmentFault]:
        """Return a function that returns the error of the present fault, even after the fault is cleared."""
        return partial(EquipmentFault, self.path, self.reason)


def equipment_in(root: Compound) -> list[Compound]:
    """Return the compounds below the root that are declared equipment, the outer before the inner."""
    compounds = (node for node in walk(root) if isinstance(node, Compound))
    return [each for each in compounds if each._settings.equipment]


class Containment:
    """The equipment of one connected machine. This object puts equipment into fault and clears faults. `is_manual`
    returns True in manual mode. `changed` is called when equipment enters a fault or is cleared."""

    def __init__(
        self,
        root: Compound,
        image: Image,
        claims: Claims,
        guards: Guards,
        is_manual: Callable[[], bool],
        changed: Callable[[Sequence[Equipment]], None],
    ) -> None:
        self._image, self._claims, self._guards = image, claims, guards
        self._is_manual, self._changed = is_manual, changed
        self.all = [self._equipment(number, each) for number, each in enumerate(equipment_in(root))]
        self._by_id = {id(each.compound): each for each in self.all}
        self._around: dict[Node, tuple[Equipment, ...]] = {}
        """The results of `around`."""
        self._gathering = False
        self._held: list[Equipment] = []
        """The equipment that has entered a fault since `gather` and has not been settled yet."""
        self._items: dict[str, Atomic] = {item.path: item for item in image.items} if self.all else {}
        """The objects by path."""
        claims.know([each.inhibition for each in self.all if each.inhibition is not None])

    def _equipment(self, number: int, compound: Compound) -> Equipment:
        items = {self._image.slot_of[id(item)]: item for item in atoms(compound)}
        place = self._claims.place
        actuators = sorted((slot for slot in items if slot in place), key=place.__getitem__)
        sensors = [slot for slot, item in items.items() if not isinstance(item, Actuator)]
        path = compound._path
        inhibition = None
        if actuators:
            interlock = Interlock(lambda: True, [compound], f"{path} is in fault")
            inhibition = Inhibition(interlock, actuators)
        in_manual_only = compound._settings.equipment == IN_MANUAL
        referenced = frozenset(slot for slot in sensors if getattr(items[slot], "incremental", False))
        nodes = (id(compound), *map(id, walk(compound)))
        return Equipment(number, compound, path, [*actuators, *sensors], in_manual_only, inhibition, referenced, nodes)

    # Whose failure it is -------------------------------------------------------------------------------

    def innermost(self, node: Node | None) -> Equipment | None:
        """Return the equipment that contains the failures of an object, or None for the machine itself."""
        for each in self.around(node):
            if each.in_fault or not each.in_manual_only or self._is_manual():
                return each
        return None

    def fault_of(self, node: Node) -> EquipmentFault | None:
        """Return the error for using an object of equipment in fault."""
        found = self._in_fault_around(node)
        return None if found is None else found.error()

    def check_may_begin(self, node: Node) -> None:
        """Raise the fault of the equipment around an object, because nothing may begin there."""
        if (found := self._in_fault_around(node)) is not None:
            raise found.error()

    def _in_fault_around(self, node: Node | None) -> Equipment | None:
        """Return the innermost equipment in fault around an object."""
        for each in self.around(node):
            if each.in_fault:
                return each
        return None

    def around(self, node: Node | None) -> tuple[Equipment, ...]:
        """Return the equipment around an object, the innermost first."""
        if node is None:
            return ()
        found = self._around.get(node)
        if found is None:
            known = (self._by_id.get(id(each)) for each in outwards(node))
            found = self._around[node] = tuple(each for each in known if each is not None)
        return found

    # Into a fault --------------------------------------------------------------------------------------

    def failed(self, what: str, failures: Sequence[Failure]) -> None:
        """Handle failures of objects: put their equipment into fault. Raises DriverError for objects outside of
        equipment."""
        own: list[Failure] = []
        contained: dict[Equipment, list[Failure]] = {}
        parent, found = None, None
        for failure in failures:
            if (item := self._items[failure.path])._parent is not parent:  # most fail beside each other
                parent, found = item._parent, self.innermost(item)
            if found is None:
                own.append(failure)
            else:
                contained.setdefault(found, []).append(failure)
        new = {equipment: each for equipment, each in contained.items() if not self.is_in_fault(equipment.compound)}
        self.enter({equipment: partial(_text_of_failures, what, each) for equipment, each in new.items()})
        if own:
            raise_failures(what, own)

    def contain(self, part: Node, error: BaseException) -> bool:
        """Put the equipment of an object into fault. Return False if no equipment contains it."""
        equipment = self.innermost(part)
        if equipment is None or is_interrupt(error):
            return False
        self._fail(equipment, fault_reason(equipment, error))
        return True

    def _fail(self, equipment: Equipment, text: Callable[[], str]) -> None:
        """Put equipment into fault because of an error with this text. If the equipment already is in fault, report the
        error as one that occurred while cleaning up."""
        if self.is_in_fault(equipment.compound):
            event = partial(_cleaning_up_event, self._image.clock.now, equipment.path, text)
            self._image.events.add(event, logged=True)
            return
        self._hold(equipment, text)
        if not self._gathering:
            self._settle_held()

    def contain_sequence(self, task: Task, error: BaseException) -> bool:
        """Handle the failure of a started sequence. A sequence that awaits the failed one gets the error. If no
        sequence of the same equipment awaits it, put the equipment into fault. Return False if no equipment contains
        it."""
        if is_interrupt(error):
            return False
        equipment = self.innermost(task.part)
        for each in task.awaited_by:
            if each is not None and (equipment is None or is_within(each.part, equipment.compound)):
                task.error = error
                return True
        if equipment is None:
            return False
        text = fault_reason(equipment, error)
        self._fail(equipment, text)
        task.fail(error, text)
        return True

    def enter(self, reasons: Mapping[Equipment, str | Callable[[], str]]) -> None:
        """Put equipment into fault, unless it already is in fault: from now on its actuators cannot be written, and
        nothing is started in it. Its actuators are brought to their defaults and its sequences and motions are ended.
        This is done immediately or, after `gather`, together with other equipment."""
        for equipment in sorted(reasons, key=attrgetter("number")):  # the outer before the inner
            if not self.is_in_fault(equipment.compound):
                self._hold(equipment, reasons[equipment])
        if not self._gathering:
            self._settle_held()

    def _hold(self, equipment: Equipment, reason: str | Callable[[], str]) -> None:
        """Put equipment into fault. The equipment is settled later."""
        equipment.enter(reason)
        self._image.columns.equipment[equipment.number] = EquipmentState.FAULT
        if equipment.inhibition is not None:
            self._claims.hold(equipment.inhibition)
        self._held.append(equipment)

    def gather(self) -> None:
        """Collect the equipment that enters a fault from now on, so that all its actuators are reset together and a
        common cause does not take more time."""
        self._gathering = True

    def settle(self) -> None:
        """Bring the actuators of the collected equipment to their defaults, and end its sequences."""
        self._gathering = False
        if self._held:
            self._settle_held()

    def _settle_held(self) -> None:
        """Settle the collected equipment. Its actuators are brought to their defaults first."""
        new, self._held = self._held, []
        inhibitions = [each.inhibition for each in new if each.inhibition is not None]
        unreached = self._claims.inhibit(inhibitions) if inhibitions else {}
        for equipment in new:
            now, path = self._image.clock.now, equipment.path
            self._image.events.add(partial(_fault_event, now, path, equipment.reason), logged=True, needed=True)
            if unreached and (left := [unreached[slot] for slot in equipment.slots if slot in unreached]):
                self._image.events.add(partial(_unreached_event, now, path, left), logged=True)
        if new:
            self._changed(new)

    def is_in_fault(self, node: Node | None) -> bool:
        """Return True if equipment around an object is in fault."""
        return self._in_fault_around(node) is not None

    # And back ------------------------------------------------------------------------------------------

    def clear(self, part: Node) -> list[str]:
        """End the faults of the equipment in a part of the machine and around it, and return their paths. Raises
        EquipmentFault if one of their sensors cannot be read; then no fault is cleared. Raises DriverError if an object
        cannot be initialised; then the equipment of the object, and the equipment within it, stays in fault."""
        self._settle_held()
        found = [each for each in self.all if each.in_fault and _concern(each.compound, part)]
        self._read_slow([slot for equipment in found for slot in equipment.slots])
        for equipment in found:
            if unread := [self._image.items[slot].path for slot in equipment.slots if self._is_unread(slot)]:
                why = f"the fault cannot be cleared while {some(unread)} cannot be read{self._absent(equipment)}"
                raise EquipmentFault(equipment.path, why)
        failures = {each: failure for each in found if (failure := self._initialize(each)) is not None}
        cleared = [each for each in found if not any(around in failures for around in self.around(each.compound))]
        for equipment in cleared:
            equipment.clear()
            self._image.failed.difference_update(equipment.slots)
        self._guards.free([each.inhibition for each in cleared if each.inhibition is not None])
        for equipment in cleared:
            self._image.columns.equipment[equipment.number] = EquipmentState.NORMAL
            self._tell(equipment, FAULT_CLEARED)
        if cleared:
            self._changed(cleared)
        if failures:
            raise_failures("could not be initialised", list(failures.values()))
        return [each.path for each in cleared]

    def _read_slow(self, slots: Sequence[int]) -> None:
        """Read those sensors of parts with their own rates that have not been read since a reading of them failed."""
        if slow := [slot for slot in slots if slot in self._image.slow and self._is_unread(slot)]:
            with suppress(DriverError):
                self._image.sample_some(slow)

    def _initialize(self, equipment: Equipment) -> Failure | None:
        """Initialise the equipment's actuators, and those of its sensors that had failed. Return the first failure, or
        None."""
        image, actuators = self._image, self._claims.place
        for slot in equipment.slots:
            if slot in actuators or slot in image.failed:
                if (failure := image.initialize(slot)) is not None:
                    return failure
                if slot in equipment.referenced:
                    image.set_referenced(slot, False)
        return None

    def _absent(self, equipment: Equipment) -> str:
        """Return which drivers of the equipment are away, as text."""
        transfer = self._image.transfer
        drivers = dict.fromkeys(transfer.wires[slot].driver for slot in equipment.slots)
        names = [transfer.words_of(driver) for driver in drivers if transfer.callees.away.is_away(driver)]
        return f"; umo is looking for a device that does not answer: {', '.join(names)}" if names else ""

    def _is_unread(self, slot: int) -> bool:
        if self._image.quality[slot] != Quality.BAD:
            return False
        item = self._image.items[slot]
        return isinstance(item, Sensor) and item.synchronous and not item._marks

    def _tell(self, equipment: Equipment, text: str) -> None:
        self._image.events.add(Event(self._image.clock.now, equipment.path, text), logged=True)


def _cleaning_up_event(now: float, path: str, text: Callable[[], str]) -> Event:
    return Event(now, path, f"{CLEANING_UP}{text()}")


def _text_of_failures(what: str, failures: Sequence[Failure]) -> str:
    return str(DriverError(what, failures))


def fault_reason(equipment: Equipment, error: BaseException) -> Callable[[], str]:
    """Return a function that makes the reason of a fault from an error. If the log "umo" takes debug messages, it gets
    the traceback now, because the error may lose its frames."""
    log.debug("%s: in fault", equipment.path, exc_info=error)
    return text_later(error, placed=True)


def _fault_event(now: float, path: str, reason: Callable[[], str]) -> Event:
    return Event(now, path, f"{FAULT_PREFIX}{reason()}", asked=FAULT)


def _unreached_event(now: float, path: str, failures: Sequence[Failure]) -> Event:
    return Event(now, path, in_a_line(_text_of_failures("has actuators not brought to their defaults yet", failures)))


def _concern(compound: Compound, part: Node) -> bool:
    return is_within(compound, part) or is_within(part, compound)
