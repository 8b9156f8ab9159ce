"""The active sequences, motions and actions of a machine. A fault of equipment ends those in the equipment; a stop ends
all."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from umo.cycle.equipment import CLEANING_UP, Containment, Equipment
from umo.cycle.events import Event
from umo.cycle.sequences import Sequences
from umo.objects import Compound, walk
from umo.user_code import Raised, attempt, told

EndIn = Callable[[Equipment, Callable[[], BaseException]], list[BaseException]]
"""Function that ends work in progress in equipment because of a fault, and returns the errors of the `finally`
blocks."""


class ActiveWork:
    """The active sequences, motions and actions of one machine."""

    def __init__(self, equipment: Containment, sequences: Sequences) -> None:
        self._equipment, self._sequences = equipment, sequences
        self.noting: list[Callable[[Sequence[Equipment]], None]] = []
        """Functions that are called first with the equipment that has entered a fault, before anything in it is
        ended."""
        self.others: list[EndIn] = []
        """Functions that end the activities of others, such as clients, in equipment."""
        self.before_cancel: list[Callable[[], object]] = []
        """Functions that cancel all activities of others. They are called before the sequences of the application are
        cancelled."""
        self._moving: dict[int, list[Compound]] = {}
        """The objects in each equipment that move by themselves, by the id of the compound. They are notified of a
        fault of the equipment."""
        for each in equipment.all:
            nodes = (node for node in (each.compound, *walk(each.compound)) if isinstance(node, Compound))
            moving = [node for node in nodes if type(node)._enter_fault is not Compound._enter_fault]
            self._moving[id(each.compound)] = moving

    @property
    def is_cut_short(self) -> bool:
        """True if a fault has ended sequences that may have been about to await others."""
        return any(each.in_fault for each in self._equipment.all)

    def note(self, faults: Sequence[Equipment]) -> None:
        """Record that this equipment has entered a fault."""
        for note in self.noting if faults else ():
            note(faults)

    def end(self, equipment: Equipment, fault: Callable[[], BaseException], now: float) -> list[Event]:
        """End all work in failed equipment. Return the events about failures in its `finally` blocks. `now`: the time
        in s on the cycle's clock."""
        raised: list[Raised] = []
        if moving := self._moving.get(id(equipment.compound)):
            raised = [error for node in moving if (error := attempt(node._enter_fault)[1]) is not None]
        errors = self._sequences.end_in(equipment.nodes, fault) if self._sequences.running else []
        for end_in in self.others:
            errors += end_in(equipment, fault)
        if not (raised or errors):
            return []
        return [Event(now, equipment.path, f"{CLEANING_UP}{each.text}") for each in [*raised, *map(told, errors)]]

    def cancel(self) -> None:
        """Cancel all work because the machine stops, the sequences of the application last. The first error of the
        `finally` blocks is raised."""
        try:
            for cancel in self.before_cancel:
                cancel()
        finally:
            self._sequences.cancel()
