"""The slots of the process image: the columns of a machine's numbers, and their blocks.

Slot order: sampled inputs, updated outputs, then the asynchronous objects. `readings.py` handles sensors,
`deliveries.py` actuators; `image.py` transfers the slots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from umo.cycle.clock import Clock
from umo.cycle.columns import Block, Columns, Scales
from umo.cycle.conversion import convert_outputs
from umo.cycle.events import Events
from umo.cycle.segments import DriverSegments
from umo.cycle.transfer import Transfer
from umo.drivers.contract import Direction
from umo.drivers.off_cycle import OffCycle
from umo.objects import Quality
from umo.objects.scaling import to_raw, to_value
from umo.wiring.rates import MACHINE_RATE
from umo.wiring.wired import Wire, Wired


class Slots:
    """The numbers of a machine's objects. An object holds its index, which is called its slot."""

    def __init__(self, wired: Wired, clock: Clock, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        """`equipment`: the number of compounds that are declared as equipment. `axes`, `alarms`: the numbers of axes
        and alarms."""
        self.clock = clock
        self.events = Events()
        """The events of the machine. They are noted in a period, and formatted after the outputs of the period were
        sent."""
        parts = _part_numbers(wired)
        self.wires = sorted(wired.wires, key=_group_order(wired.wires, parts))
        self.items = [wire.item for wire in self.wires]
        self.wire_texts: Sequence[str] = wired.texts_of(self.wires)
        self.slot_of = {id(item): slot for slot, item in enumerate(self.items)}
        self.timer = -1 if wired.timer is None else self.slot_of[id(wired.timer)]
        self._least_ticks, self._most_ticks = self.wires[self.timer].raw_bounds if wired.timer is not None else (0, 0)
        count = len(self.wires)
        self.columns = columns = Columns(count, equipment, axes, alarms)
        self.pending: Any = columns.pending.data
        self.sent: Any = columns.sent.data
        self.sent_raws: Any = columns.sent_raws.data
        self.stepped: Any = columns.stepped.data
        self.times: Any = columns.times.data
        self.values: Any = columns.values.data
        self.raws: Any = columns.raws.data
        self.quality: Any = columns.quality.data
        self.restrictions: Any = columns.restrictions.data
        self.transfer = Transfer(self.wires, wired, self.timer, columns.raws)
        self.segments = DriverSegments(self.transfer, wired)
        self.scales = scales = Scales(self.wires, self.transfer.defaults)
        self._defaults = scales.defaults.data
        self.base = [Quality.UNREFERENCED if item._incremental else Quality.GOOD for item in self.items]
        inputs, outputs = self._blocks(Direction.INPUT, parts), self._blocks(Direction.OUTPUT, parts)
        self.blocks = [*inputs, *outputs]
        self.inputs = [block for block in inputs if not isinstance(block.driver, OffCycle)]
        """The blocks that are read in periods."""
        self.outputs = [block for block in outputs if not isinstance(block.driver, OffCycle)]
        """The blocks that are sent in periods."""
        self._block_of: list[Block | None] = [None] * count
        """The block of each slot; None for an asynchronous object."""
        for block in self.blocks:
            self._block_of[block.slots] = [block] * (block.stop - block.start)
        slow = [block for block in self.blocks if block.part != MACHINE_RATE]
        self.slow = frozenset(slot for block in slow for slot in range(block.start, block.stop))
        """The slots of parts that do not have the machine's rate."""
        self.transfer.bind(self.inputs, self.outputs)
        self.sampled_good: bool | None = None
        """True if all of `sampled` are GOOD; None if a quality has changed since the last check."""
        self.sampled = slice(0, inputs[-1].stop if inputs else 0)
        for block in outputs:
            convert_outputs(block, columns, scales)
        columns.pending[:] = columns.sent[:] = columns.values[:] = scales.defaults  # of a sensor NaN: nothing was read
        columns.sent_raws[:] = scales.default_raws
        columns.stepped.fill(clock.now)  # a rate begins there
        columns.quality[:] = np.where(np.isnan(scales.defaults), int(Quality.BAD), int(Quality.GOOD))
        for block in inputs:
            block.unsettled.update(range(block.start, block.stop))

    def _blocks(self, direction: Direction, parts: Mapping[int, int]) -> list[Block]:
        inputs = direction is Direction.INPUT
        slots = [s for s, item in enumerate(self.items) if item.synchronous and item.direction is direction]
        blocks = []
        numbers = [parts.get(id(item), MACHINE_RATE) for item in self.items]
        for (part, _), slots_of_one in groupby(slots, lambda slot: (numbers[slot], id(self.wires[slot].driver))):
            group = list(slots_of_one)
            start, stop = group[0], group[-1] + 1
            raws = np.zeros(len(group), np.int64) if inputs else self.columns.sent_raws[start:stop]
            channels = tuple(self.wires[slot].channel for slot in group)
            blocks.append(Block(self.wires[start].driver, channels, start, raws, inputs, part))
        return blocks

    def value_of(self, slot: int, raw: int) -> float:
        """Return the value of a raw integer."""
        scales = self.scales
        value = to_value(raw, scales.resolution.item(slot), scales.zero_offset.item(slot))
        linearization = scales.linearizations[slot]
        return value if linearization is None else linearization.to_value(value)

    def nearest(self, slot: int, value: float) -> int:
        """Return the raw integer nearest to a value, even outside the range."""
        scales, linearization = self.scales, self.scales.linearizations[slot]
        quantity = value if linearization is None else linearization.to_input(value)
        return to_raw(quantity, scales.resolution.item(slot), scales.zero_offset.item(slot))

    def set_quality(self, slot: int, quality: Quality) -> None:
        self.quality[slot] = int(quality)
        self.sampled_good = None
        if quality is not self.base[slot] and (block := self._block_of[slot]) is not None:
            block.unsettled.add(slot)


def _part_numbers(wired: Wired) -> Mapping[int, int]:
    """Return the number of the part with its own rate to which each object belongs, by the object's id, for the objects
    that belong to such a part. Objects of drivers off the cycle are left out, because such a driver has its own
    times."""
    if not wired.rates:
        return {}
    on_cycle = (wire.item for wire in wired.wires if not isinstance(wire.driver, OffCycle))
    return {id(item): number for item in on_cycle if (number := wired.rates.number(item)) != MACHINE_RATE}


def _group_order(wires: Sequence[Wire], parts: Mapping[int, int]) -> Any:
    """Return the sort key of the slot order: sampled inputs, updated outputs, asynchronous objects; within each group
    by driver, then by part, then in the order of declaration."""
    drivers: dict[int, int] = {}
    for wire in wires:
        drivers.setdefault(id(wire.driver), len(drivers))

    def key(wire: Wire) -> tuple[bool, bool, int, int]:
        item = wire.item
        part = parts.get(id(item), MACHINE_RATE) if item.synchronous else MACHINE_RATE
        return not item.synchronous, item.direction is Direction.OUTPUT, drivers[id(wire.driver)], part

    return key
