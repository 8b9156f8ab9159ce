"""The slots of the process image: the columns of a machine's numbers, their blocks, and what becomes of one object.

Slot order: sampled inputs, updated outputs, then the asynchronous objects. A sensor is judged here after its
reading, or fails; what becomes of an actuator is in `deliveries.py`, what moves the slots in `image.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any, Protocol, cast

import numpy as np

from umo.cycle.clock import Clock
from umo.cycle.columns import Block, Columns, Scales
from umo.cycle.conditioning import ConditionedInputs, conditioner_of
from umo.cycle.conversion import convert_inputs, convert_outputs
from umo.cycle.events import Events
from umo.cycle.transfer import Transfer, cause_of_failure
from umo.drivers.contract import UNREAD, Direction
from umo.drivers.off_cycle import OffCycle
from umo.errors import BadInput, DriverError, Failure, RangeError
from umo.objects import Quality, Sensor
from umo.objects.atomic import Digital
from umo.objects.scaling import to_raw, to_value
from umo.wiring.rates import WHOLE, RateMap
from umo.wiring.wired import Wire, Wired

MARKED_LOG_INTERVAL = 10.0
"""Least time in s between two lines of the log about one sensor that is marked BAD."""
MAX_OFFSET_RAW = 2.0**62
"""Largest zero offset that is accepted, in raw integers."""


class Elsewhere(Protocol):
    """The circuits whose values come at times of their own (`umo.cycle.off_cycle`)."""

    def read_at(self, slot: int) -> float:
        """The time in s of the reading that is being accepted."""

    def was_read(self, slot: int, failures: list[Failure]) -> None:
        """A reading was accepted: it has its own time."""


class Slots:
    """The numbers of a machine's objects; an object holds its index, its slot."""

    def __init__(self, wired: Wired, clock: Clock, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        """`equipment`: the number of the compounds that are declared equipment; `axes`, `alarms`: that of these."""
        self.clock = clock
        self.events = Events()
        """What has happened in the machine: noted in a period, told when its outputs have been sent."""
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
        self.scales = scales = Scales(self.wires, self.transfer.defaults)
        self._low, self._high, self._defaults = scales.low.data, scales.high.data, scales.defaults.data
        self.elsewhere: dict[int, Elsewhere] = {}
        """By sensor, what is read at times of its own."""
        self.found: list[Failure] = []
        """Failures that were found since the last sample, which tells them."""
        self.failed: set[int] = set()
        """The sensors that failed and have not been initialised since."""
        self._marked: list[tuple[int, str]] = []
        """Failures of the sensors that were marked BAD and not logged yet."""
        self._next_log: dict[int, float] = {}
        """Time in s from which a marked sensor is logged again, by slot."""
        sensors = (slot for slot, item in enumerate(self.items) if item.direction is Direction.INPUT)
        self.invalid_raws = {slot: raws for slot in sensors if (raws := self._invalid(slot))}
        self.base = [Quality.UNREFERENCED if item._incremental else Quality.GOOD for item in self.items]
        found = ((slot, conditioner_of(wire)) for slot, wire in enumerate(self.wires))
        self.conditioners = {slot: each for slot, each in found if each is not None}
        """Of the sensors that are conditioned."""
        inputs, outputs = self._blocks(Direction.INPUT, parts), self._blocks(Direction.OUTPUT, parts)
        self.blocks = [*inputs, *outputs]
        self.inputs = [block for block in inputs if not isinstance(block.driver, OffCycle)]
        """The blocks that are read in periods."""
        self.outputs = [block for block in outputs if not isinstance(block.driver, OffCycle)]
        """The blocks that are sent in periods."""
        self._block_of: list[Block | None] = [None] * count
        """The block in which each slot stands; None for what is asynchronous."""
        for block in self.blocks:
            self._block_of[block.slots] = [block] * (block.stop - block.start)
        slow = [block for block in self.blocks if block.part != WHOLE]
        self.slow = frozenset(slot for block in slow for slot in range(block.start, block.stop))
        """The slots of parts that have rates of their own."""
        self.transfer.bind(self.inputs, self.outputs)
        self.sampled_good: bool | None = None
        """Whether all of `sampled` are GOOD; None: a quality has changed since the last check."""
        self.sampled = slice(0, inputs[-1].stop if inputs else 0)
        for block in inputs:
            self._prepare(block)
        for block in outputs:
            convert_outputs(block, columns, scales)
        columns.pending[:] = columns.sent[:] = columns.values[:] = scales.defaults  # of a sensor NaN: nothing was read
        columns.sent_raws[:] = scales.default_raws
        columns.stepped.fill(clock.now)  # a rate begins there
        columns.quality[:] = np.where(np.isnan(scales.defaults), int(Quality.BAD), int(Quality.GOOD))
        for block in inputs:
            block.unsettled.update(range(block.start, block.stop))

    def _prepare(self, block: Block) -> None:
        """An input block: a raw integer that the circuit reports as invalid gives a value that is out of bounds."""
        hidden: dict[int, list[int]] = {}
        for slot, raws in self.invalid_raws.items():
            for raw in raws if block.start <= slot < block.stop else ():
                if self._is_inside(slot, self.value_of(slot, raw)):
                    hidden.setdefault(raw, []).append(slot - block.start)
        convert_inputs(block, self.columns, self.scales, hidden)
        mine = {slot: each for slot, each in self.conditioners.items() if block.start <= slot < block.stop}
        if mine:
            block.conditioned = ConditionedInputs(block, self.columns, mine, self._is_refused)
            block.convert = block.conditioned.convert

    def _blocks(self, direction: Direction, parts: Mapping[int, int]) -> list[Block]:
        inputs = direction is Direction.INPUT
        slots = [s for s, item in enumerate(self.items) if item.synchronous and item.direction is direction]
        blocks = []
        for (part, _), slots_of_one in groupby(
            slots, lambda slot: (self._part(slot, parts), id(self.wires[slot].driver))
        ):
            group = list(slots_of_one)
            start, stop = group[0], group[-1] + 1
            raws = np.zeros(len(group), np.int64) if inputs else self.columns.sent_raws[start:stop]
            channels = tuple(self.wires[slot].channel for slot in group)
            blocks.append(Block(self.wires[start].driver, channels, start, raws, inputs, part))
        return blocks

    def _part(self, slot: int, parts: Mapping[int, int]) -> int:
        return parts.get(id(self.items[slot]), WHOLE)

    def set_reading(self, slot: int, value: float) -> None:
        """Change the zero offset of a digital sensor so that its last reading is this value."""
        item = cast(Digital, self.items[slot])
        if self.quality[slot] == Quality.BAD:
            raise BadInput(item.path, Quality.BAD)
        resolution = float(self.scales.resolution[slot])
        conditioner = self.conditioners.get(slot)
        reading = None if conditioner is None else conditioner.reading
        if reading is None:
            reading = self.values[slot]  # `raws` may be of a reading that failed
        raw = self.nearest(slot, reading)
        zero_offset = value - to_value(raw, resolution, 0.0)
        if not abs(zero_offset) < MAX_OFFSET_RAW * abs(resolution):
            raise RangeError(f"{item.path}: {value:g} {item.units} is no place that it can have")
        item._calibrate(item.calibration._replace(zero_offset=zero_offset))
        distance = zero_offset - float(self.scales.zero_offset[slot])
        self.scales.zero_offset[slot] = zero_offset
        if conditioner is None:
            self.values[slot] = to_value(raw, resolution, zero_offset)
        else:  # a filtered value keeps its lag
            conditioner.shift(distance)
            self.values[slot] += distance
        for block in self.blocks:
            if block.start <= slot < block.stop:
                self._prepare(block)

    def set_referenced(self, slot: int, referenced: bool) -> None:
        self.base[slot] = Quality.GOOD if referenced else Quality.UNREFERENCED
        item, quality = cast(Sensor, self.items[slot]), self.quality[slot]
        held = item._max_age is not None and item.synchronous and self.times[slot] < self.clock.now
        if quality != Quality.BAD and not (held and referenced):
            self.set_quality(slot, self._judge(slot, self.values[slot]))
        elif quality == Quality.UNREFERENCED:  # the held value is referenced from now on, but it is still old
            self.set_quality(slot, Quality.STALE)

    def value_of(self, slot: int, raw: int) -> float:
        """The value that a raw integer stands for."""
        scales = self.scales
        value = to_value(raw, scales.resolution.item(slot), scales.zero_offset.item(slot))
        linearization = scales.linearizations[slot]
        return value if linearization is None else linearization.to_value(value)

    def nearest(self, slot: int, value: float) -> int:
        """The raw integer nearest to a value, also outside the range."""
        scales, linearization = self.scales, self.scales.linearizations[slot]
        quantity = value if linearization is None else linearization.to_input(value)
        return to_raw(quantity, scales.resolution.item(slot), scales.zero_offset.item(slot))

    def _is_inside(self, slot: int, value: float) -> bool:
        """Whether a sensor's value is GOOD."""
        return self._low[slot] <= value <= self._high[slot]

    def _judge(self, slot: int, value: float) -> Quality:
        if self.base[slot] is not Quality.GOOD or self._is_inside(slot, value):
            return self.base[slot]
        return Quality.OUT_OF_RANGE

    def set_quality(self, slot: int, quality: Quality) -> None:
        self.quality[slot] = int(quality)
        self.sampled_good = None
        if quality is not self.base[slot] and (block := self._block_of[slot]) is not None:
            block.unsettled.add(slot)

    def settle_block(
        self, block: Block, outside: Sequence[tuple[int, float]], now: float, failures: list[Failure]
    ) -> None:
        """The slow path of `sample`: something in the block is, or was, not as it should be."""
        failed = {slot: (cause, self.times[slot]) for slot, _ in outside if (cause := self._refused(slot))}
        for slot in block.unsettled - failed.keys():
            self.set_quality(slot, self.base[slot])
        block.unsettled &= failed.keys()
        for slot, value in outside:
            if slot not in failed:
                self.values[slot] = value
                self.set_quality(slot, self._judge(slot, value))
        self.columns.times[block.slots] = now
        for slot, (cause, time) in failed.items():
            self.times[slot] = time
            self.fail_input(slot, cause, failures)

    def _invalid(self, slot: int) -> tuple[int, ...]:
        """The raw integers that are not readings: those of the wiring, and the mark of a place that was not read where
        it would lie within the range."""
        unread = (UNREAD,) if self._is_inside(slot, self.value_of(slot, UNREAD)) else ()
        return (*self.wires[slot].invalid_raws, *unread)

    def _read_at(self, slot: int) -> float:
        """The time in s of the reading that is being accepted."""
        elsewhere = self.elsewhere.get(slot)
        return self.clock.read() if elsewhere is None else elsewhere.read_at(slot)

    def velocity(self, slot: int) -> float:
        """Of a sensor, units per s; BadInput while it is BAD."""
        if self.quality[slot] == Quality.BAD:
            raise BadInput(self.items[slot].path, Quality.BAD)
        return self.conditioners[slot].velocity

    def _is_refused(self, slot: int, raw: int) -> bool:
        """Whether a raw integer is no reading."""
        if (levels := self.items[slot]._raws) is not None:
            return raw not in levels
        return raw in self.invalid_raws.get(slot, ()) or raw == UNREAD

    def _refused(self, slot: int) -> str:
        """Why its raw value, which is in `raws`, is not a reading; empty if it is one."""
        raw = self.raws[slot]
        if raw == UNREAD:
            return "the driver returned fewer values than channels"
        if (levels := self.items[slot]._raws) is not None and raw not in levels:
            return f"read {raw}, but a {self.items[slot]._word} channel reads {' or '.join(map(str, levels))}"
        return f"the circuit reports an invalid reading (raw {raw})" if raw in self.invalid_raws.get(slot, ()) else ""

    def accept(self, slot: int, raw: int, failures: list[Failure]) -> None:
        """One sensor was read."""
        conditioner = self.conditioners.get(slot) if self.conditioners else None
        is_reading = conditioner is not None and not self._is_refused(slot, raw)
        try:
            value = self.value_of(slot, conditioner.count_of(raw) if conditioner and is_reading else raw)
        except Exception as error:  # of a linearization of the user's
            self.fail_input(slot, f"its linearization failed: {cause_of_failure(error)}", failures)
            return
        inside = self._is_inside(slot, value)
        if (slot in self.invalid_raws or not inside) and (cause := self._refused(slot)):
            self.fail_input(slot, cause, failures)
            return
        if conditioner is not None:
            value = conditioner.conditioned(value, self._read_at(slot), inside)
        self.values[slot] = value
        self.times[slot] = self.clock.now
        if not inside or self.quality[slot] != self.base[slot]:
            self.set_quality(slot, self._judge(slot, value))
        if slot in self.elsewhere:
            self.elsewhere[slot].was_read(slot, failures)

    def fail_input(self, slot: int, cause: str, failures: list[Failure]) -> None:
        item: Any = self.items[slot]
        max_age = item._max_age
        if max_age is not None and self.clock.now - self.times[slot] <= max_age:  # NaN before the first reading
            if self.quality[slot] == Quality.GOOD:  # what was not good is no better for being held
                self.set_quality(slot, Quality.STALE)
        elif item._marks:
            if self.quality[slot] != Quality.BAD:
                self.set_quality(slot, Quality.BAD)
                if self.clock.now >= self._next_log.get(slot, 0.0):
                    self._next_log[slot] = self.clock.now + MARKED_LOG_INTERVAL
                    self._marked.append((slot, cause))
        else:
            self.failed.add(slot)
            self.set_quality(slot, Quality.BAD)
            failures.append(self.transfer.failure(slot, cause))

    def fail_inputs(self, causes: Mapping[int, str], failures: list[Failure]) -> None:
        """The same of many, such as all that a driver reads."""
        items: Any = self.items
        plain, marked = [], []
        for slot, cause in causes.items():
            item = items[slot]
            if item._max_age is not None:
                self.fail_input(slot, cause, failures)
            elif not item._marks:
                plain.append(slot)
            elif self.quality[slot] != Quality.BAD:
                marked.append(slot)
        if not (plain or marked):
            return
        self.failed.update(plain)
        self.columns.quality[plain + marked] = Quality.BAD
        self.sampled_good = None
        for slot in plain + marked:
            if (block := self._block_of[slot]) is not None:
                block.unsettled.add(slot)
        failure, now, told = self.transfer.failure, self.clock.now, self._next_log
        failures += [failure(slot, causes[slot]) for slot in plain]
        if due := [slot for slot in marked if now >= told.get(slot, 0.0)]:
            told.update(dict.fromkeys(due, now + MARKED_LOG_INTERVAL))
            self._marked += [(slot, causes[slot]) for slot in due]

    def _log_marked(self) -> None:
        """Log together what was marked BAD together: a thousand lines would take longer than a period."""
        if self._marked:
            self.events.log(partial(_marked_text, self.transfer, self._marked))
            self._marked = []


def _marked_text(transfer: Transfer, marked: Sequence[tuple[int, str]]) -> str:
    return str(DriverError("marked BAD", [transfer.failure(slot, cause) for slot, cause in marked]))


def _part_numbers(wired: Wired) -> Mapping[int, int]:
    """The number of the part to which each object belongs, by the object's id, of those that belong to one. A driver
    off the cycle has its own times."""
    if not wired.rates:
        return {}
    parts = RateMap(wired.rates)
    on_cycle = (wire.item for wire in wired.wires if not isinstance(wire.driver, OffCycle))
    return {id(item): number for item in on_cycle if (number := parts.number(item)) != WHOLE}


def _group_order(wires: Sequence[Wire], parts: Mapping[int, int]) -> Any:
    """Sampled inputs, updated outputs, asynchronous; within each by driver, then by part, then as declared."""
    drivers: dict[int, int] = {}
    for wire in wires:
        drivers.setdefault(id(wire.driver), len(drivers))

    def key(wire: Wire) -> tuple[bool, bool, int, int]:
        item = wire.item
        part = parts.get(id(item), WHOLE) if item.synchronous else WHOLE
        return not item.synchronous, item.direction is Direction.OUTPUT, drivers[id(wire.driver)], part

    return key
