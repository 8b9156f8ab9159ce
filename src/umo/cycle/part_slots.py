"""The slots of each part of a machine: the slots that `sample`, `update`, `reset` and `acknowledge` of a compound
use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from umo.cycle.image import Image
from umo.drivers.contract import Direction
from umo.objects import Atomic, Node, atoms


class PartSlots(NamedTuple):
    """The slots of a part."""

    inputs: list[int]
    """Slots to sample."""
    outputs: list[int]
    """Slots to update."""
    all: list[int]
    """Slots to reset: the actuators in stop order, then the sensors."""
    actuators: frozenset[int]


class SlotsOfParts:
    """The slots of all parts of one machine. The slots of a part are found when they are first read. `place`: the index
    of each actuator in stop order."""

    def __init__(self, image: Image, place: Mapping[int, int]) -> None:
        self._image, self._place = image, place
        self._known: dict[int, PartSlots] = {}

    def of(self, part: Node) -> PartSlots:
        """Return the slots of one part, an object or a compound."""
        found = self._known.get(id(part))
        if found is None:
            found = self._known[id(part)] = self._found(part)
        return found

    def _found(self, part: Node) -> PartSlots:
        slot_of, place = self._image.slot_of, self._place
        items = {slot_of[id(item)]: item for item in ([part] if isinstance(part, Atomic) else atoms(part))}
        sensors = [slot for slot, item in items.items() if item.direction is Direction.INPUT]
        actuators = sorted((slot for slot in items if slot in place), key=place.__getitem__)
        return PartSlots(
            [slot for slot in sensors if items[slot].synchronous],
            [slot for slot, item in items.items() if item.synchronous and item.direction is Direction.OUTPUT],
            [*actuators, *sensors],
            frozenset(actuators),
        )
