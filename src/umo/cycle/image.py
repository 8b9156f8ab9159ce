"""The process image: flat sequences of raw integers and of values; an object holds its index, its slot.

Slots stand in blocks, one for each driver and direction, so that a period is one transfer a block. The two
forms (`forms.py`) store the same numbers in lists or in arrays; all decisions are taken here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from operator import index
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from umo.cycle.block import Block
from umo.cycle.clock import Clock
from umo.cycle.journal import Journal, Kind
from umo.drivers.contract import Channel, Direction, Driver
from umo.errors import DriverError, Failure
from umo.objects import Atomic, Binary, BinaryActuator, BinarySensor, DigitalActuator, DigitalSensor, Quality
from umo.objects.scaling import FloatArray, IntArray, to_raw, to_value
from umo.text import cause_of
from umo.wiring.resolved import Wire

if TYPE_CHECKING:
    from umo.cycle.guards import Guard

Actuator = BinaryActuator[Any] | DigitalActuator
Sensor = BinarySensor[Any] | DigitalSensor


class Image(ABC):
    """Both forms' common part. Slot order: sampled inputs, updated outputs, then the asynchronous objects."""

    values: Any
    pending: Any
    quality: Any
    times: Any

    def __init__(self, wires: Sequence[Wire], clock: Clock, timer: Atomic | None = None) -> None:
        self.clock = clock
        self.wires = sorted(wires, key=_group_order(wires))
        self.items = [wire.item for wire in self.wires]
        self.slot_of = {id(item): slot for slot, item in enumerate(self.items)}
        self.timer = -1 if timer is None else self.slot_of[id(timer)]
        self.guards: dict[int, Guard] = {}
        """By slot, those actuators whose writes are looked at (`umo.cycle.guards`)."""
        self.slewed: list[Guard] = []
        self.journal: Journal | None = None
        """Where asynchronous traffic is noted, if someone reads it."""
        count = len(self.wires)
        self.raws_array = np.zeros(count, np.int64)
        self.pending_raws_array = np.zeros(count, np.int64)
        self.raws: Any = self.raws_array.data  # a memoryview: quicker than numpy's items
        self.pending_raws: Any = self.pending_raws_array.data
        self.scales = [(*wire.scale, *_bounds(wire)) for wire in self.wires]
        self.base = [_base_quality(item) for item in self.items]
        self._make(count)
        self.inputs = self._blocks(Direction.INPUT)
        self.outputs = self._blocks(Direction.OUTPUT)
        self._good: bool | None = None
        """Whether all of `sampled` are GOOD; None when a quality has changed since that was looked up."""
        self.sampled = slice(0, self.inputs[-1].stop if self.inputs else 0)
        for block in self.inputs:
            self._prepare(block)
        for slot, item in enumerate(self.items):
            self._set_quality(slot, self.base[slot])
            if item.direction is Direction.OUTPUT:
                self._set_default(slot)
            item._connect(self, slot)

    def disconnect(self) -> None:
        for item in self.items:
            item._disconnect()

    # What the two forms do differently -----------------------------------------------------------------

    @abstractmethod
    def _make(self, count: int) -> None:
        """Make the sequences `values`, `pending`, `quality` and `times`."""

    @abstractmethod
    def _prepare(self, block: Block) -> None:
        """What `_convert` will want of an input block."""

    @abstractmethod
    def _convert(self, block: Block, now: float) -> list[tuple[int, float]]:
        """Buffer to raws, values and times. If any values are out of bounds, their (slot, value) pairs are
        returned and not kept, and the times are left to the caller."""

    @abstractmethod
    def _commit(self, block: Block, now: float) -> None:
        """What was pending is now at the hardware."""

    @abstractmethod
    def _stamp(self, block: Block, now: float) -> None: ...

    @abstractmethod
    def put_pending(self, slots: slice | IntArray, values: FloatArray, raws: IntArray) -> None:
        """Many written at once; the values were checked."""

    @property
    def whole(self) -> Image:
        return self

    @abstractmethod
    def get_values(self, slots: slice | IntArray) -> FloatArray:
        """A new array."""

    # A whole period ------------------------------------------------------------------------------------

    def sample(self) -> bool:
        """Every synchronous sensor, one transfer a driver. A failed block does not stop the others."""
        failures: list[Failure] = []
        now = self.clock.now
        for block in self.inputs:
            try:
                block.driver.read_many(block.channels, block.buffer)
            except Exception as error:
                for slot in range(block.start, block.stop):
                    self._fail_input(slot, cause_of(error), failures)
                continue
            outside = self._convert(block, now)
            if outside or block.unsettled:
                self._settle(block, outside, now, failures)
        if failures:
            raise DriverError("could not be read", failures)
        if self._good is None:
            self._good = not any(self.quality[self.sampled])
        return self._good

    def update(self) -> bool:
        """Every synchronous actuator, written since or not, one transfer a driver."""
        for guard in self.slewed:
            guard.slew()
        failures: list[Failure] = []
        now = self.clock.now
        for block in self.outputs:
            try:
                block.driver.write_many(block.channels, block.buffer)
            except Exception as error:
                for slot in range(block.start, block.stop):
                    self._fail_output(slot, cause_of(error), failures)
                continue
            self._commit(block, now)
            if block.unsettled:
                for slot in block.unsettled:
                    self._set_quality(slot, Quality.GOOD)
                block.unsettled.clear()
        if failures:
            raise DriverError("could not be written", failures)
        return True

    # Some objects --------------------------------------------------------------------------------------

    def read_now(self, slot: int) -> float:
        """An asynchronous sensor: the hardware, now. The timer's moves the clock."""
        wire, before = self.wires[slot], self.raws[slot]
        failures: list[Failure] = []
        try:
            self.raws[slot] = raw = index(wire.driver.read(wire.channel))
        except Exception as error:
            self.note(slot, Kind.FAILED_READ)
            self._fail_input(slot, cause_of(error), failures)
        else:
            if slot == self.timer:
                self.clock.advance(raw)
            self._accept(slot, raw, failures)
            self.note(slot, Kind.READ, before)
        _raise(failures, "could not be read")
        return cast(float, self.values[slot])

    def sample_some(self, slots: Sequence[int]) -> bool:
        failures: list[Failure] = []
        for driver, group in self._by_driver(slots):
            out = np.empty(len(group), np.int64)
            try:
                driver.read_many(self._channels(group), out)
            except Exception as error:
                for slot in group:
                    self._fail_input(slot, cause_of(error), failures)
            else:
                for slot, raw in zip(group, out.tolist(), strict=True):
                    self._accept(slot, raw, failures)
        _raise(failures, "could not be read")
        return all(self.quality[slot] == Quality.GOOD for slot in slots)

    def update_some(self, slots: Sequence[int]) -> bool:
        for guard in self.slewed:
            if guard.slot in slots:
                guard.slew()
        failures: list[Failure] = []
        for driver, group in self._by_driver(slots):
            try:
                driver.write_many(self._channels(group), self.pending_raws_array[group])
            except Exception as error:
                for slot in group:
                    self._fail_output(slot, cause_of(error), failures)
            else:
                for slot in group:
                    self._accepted(slot)
        _raise(failures, "could not be written")
        return True

    def send(self, slot: int) -> bool:
        """An asynchronous actuator was written."""
        wire, before = self.wires[slot], self.raws[slot]
        failures: list[Failure] = []
        try:
            wire.driver.write(wire.channel, self.pending_raws[slot])
        except Exception as error:
            self.note(slot, Kind.FAILED_WRITE)
            self._fail_output(slot, cause_of(error), failures)
        else:
            self._accepted(slot)
            self.note(slot, Kind.WRITE, before)
        _raise(failures, "could not be written")
        return True

    def write_many(self, slots: slice | IntArray, each: Sequence[int], values: FloatArray, raws: IntArray) -> None:
        """Many written at once, all or nothing; their ranges were checked. `each` lists the same slots."""
        if not self.guards:
            self.put_pending(slots, values, raws)
            return
        guarded = [(self.guards[s], float(v)) for s, v in zip(each, values, strict=True) if s in self.guards]
        for guard, value in guarded:
            guard.check(value)
        self.put_pending(slots, values, raws)
        for guard, value in guarded:
            guard.take(value)

    def reset_some(self, slots: Iterable[int]) -> None:
        failures = self.try_each(slots, "reset")
        _raise(failures, "could not be reset")

    def try_each(self, slots: Iterable[int], segment: str) -> list[Failure]:
        """Call the driver's `initialize` or `reset` for each; one failure never stops the rest."""
        failures: list[Failure] = []
        for slot in slots:
            wire, item, before = self.wires[slot], self.items[slot], self.raws[slot]
            default = None
            if item.direction is Direction.OUTPUT:
                self._set_default(slot)
                default = self.pending_raws[slot]
                if slot in self.guards:
                    self.guards[slot].rest()
            try:
                getattr(wire.driver, segment)(wire.channel, default)
            except Exception as error:
                failures.append(Failure(item.path, wire.channel.text, cause_of(error)))
                self._set_quality(slot, Quality.BAD)
                self.note(slot, Kind.FAILED_RESET)
            else:
                if default is not None:
                    self._accepted(slot)
                self.note(slot, Kind.RESET, before)
        return failures

    def set_referenced(self, slot: int, referenced: bool) -> None:
        self.base[slot] = Quality.GOOD if referenced else Quality.UNREFERENCED
        if self.quality[slot] in (Quality.GOOD, Quality.OUT_OF_RANGE, Quality.UNREFERENCED):
            self._set_quality(slot, self._judge(slot, self.values[slot]))

    # Inside --------------------------------------------------------------------------------------------

    def note(self, slot: int, kind: Kind, before: int | None = None) -> None:
        """Into the journal, if one is kept; `before` is the raw that the slot had, None where it is still that."""
        if self.journal is not None and slot != self.timer:
            raw = self.raws[slot]
            self.journal.add(slot, kind, raw, raw if before is None else before)

    def _settle(self, block: Block, outside: list[tuple[int, float]], now: float, failures: list[Failure]) -> None:
        """The slow path of `sample`: something in the block is, or was, not as it should be."""
        for slot in block.unsettled:
            self._set_quality(slot, self.base[slot])
        block.unsettled.clear()
        garbled = []
        for slot, value in outside:
            if isinstance(self.items[slot], Binary):
                garbled.append((slot, self.times[slot]))
            else:
                self.values[slot] = value
                self._set_quality(slot, self._judge(slot, value))
        self._stamp(block, now)
        for slot, time in garbled:
            self.times[slot] = time
            self._fail_input(slot, _not_binary(self.raws[slot]), failures)

    def _accept(self, slot: int, raw: int, failures: list[Failure]) -> None:
        """One sensor was read."""
        resolution, zero_offset, low, high = self.scales[slot]
        value = to_value(raw, resolution, zero_offset)
        self.raws[slot] = raw
        if isinstance(self.items[slot], Binary) and not low <= value <= high:
            self._fail_input(slot, _not_binary(raw), failures)
            return
        self.values[slot] = value
        self.times[slot] = self.clock.now
        self._set_quality(slot, self._judge(slot, value))

    def _judge(self, slot: int, value: float) -> Quality:
        _, _, low, high = self.scales[slot]
        if self.base[slot] is not Quality.GOOD or low <= value <= high:
            return self.base[slot]
        return Quality.OUT_OF_RANGE

    def _accepted(self, slot: int) -> None:
        """One actuator's pending value is at the hardware."""
        self.values[slot] = self.pending[slot]
        self.raws[slot] = self.pending_raws[slot]
        self.times[slot] = self.clock.now
        self.quality[slot] = Quality.GOOD

    def _fail_input(self, slot: int, cause: str, failures: list[Failure]) -> None:
        item = cast(Sensor, self.items[slot])
        age = self.clock.now - self.times[slot]  # NaN before the first reading
        if item._max_age is not None and age <= item._max_age:
            self._set_quality(slot, Quality.STALE)
        else:
            self._fail_output(slot, cause, failures)

    def _fail_output(self, slot: int, cause: str, failures: list[Failure]) -> None:
        self._set_quality(slot, Quality.BAD)
        failures.append(Failure(self.items[slot].path, self.wires[slot].channel.text, cause))

    def _set_quality(self, slot: int, quality: Quality) -> None:
        self.quality[slot] = int(quality)
        self._good = None
        if quality is not self.base[slot]:
            for block in (*self.inputs, *self.outputs):
                if block.start <= slot < block.stop:
                    block.unsettled.add(slot)

    def _set_default(self, slot: int) -> None:
        value = cast(Actuator, self.items[slot])._default_value()
        self.pending[slot] = value
        self.pending_raws[slot] = to_raw(value, *self.wires[slot].scale)

    def _by_driver(self, slots: Sequence[int]) -> list[tuple[Driver, list[int]]]:
        groups: dict[int, tuple[Driver, list[int]]] = {}
        for slot in slots:
            driver = self.wires[slot].driver
            groups.setdefault(id(driver), (driver, []))[1].append(slot)
        return list(groups.values())

    def _channels(self, slots: Iterable[int]) -> tuple[Channel, ...]:
        return tuple(self.wires[slot].channel for slot in slots)

    def _blocks(self, direction: Direction) -> list[Block]:
        inputs = direction is Direction.INPUT
        slots = [s for s, item in enumerate(self.items) if item.synchronous and item.direction is direction]
        blocks = []
        for driver, group in self._by_driver(slots):
            start, stop = group[0], group[-1] + 1
            buffer = np.zeros(len(group), np.int64) if inputs else self.pending_raws_array[start:stop]
            buffer.flags.writeable = inputs  # what is pending is not the driver's to change
            blocks.append(Block(driver, self._channels(group), start, buffer))
        return blocks


def _group_order(wires: Sequence[Wire]) -> Any:
    """Sampled inputs, updated outputs, asynchronous; within each by driver, then as declared."""
    drivers: dict[int, int] = {}
    for wire in wires:
        drivers.setdefault(id(wire.driver), len(drivers))

    def key(wire: Wire) -> tuple[bool, bool, int]:
        return not wire.item.synchronous, wire.item.direction is Direction.OUTPUT, drivers[id(wire.driver)]

    return key


def _bounds(wire: Wire) -> tuple[float, float]:
    """Half a resolution beyond the range is still GOOD; a binary level is exactly 0 or 1."""
    if wire.calibration is None:
        return 0.0, 1.0
    half = abs(wire.calibration.resolution) / 2
    return wire.calibration.minimum - half, wire.calibration.maximum + half


def _base_quality(item: Atomic) -> Quality:
    incremental = isinstance(item, DigitalSensor) and item.incremental
    return Quality.UNREFERENCED if incremental else Quality.GOOD


def _not_binary(raw: int) -> str:
    return f"read {raw}; a binary channel reads 0 or 1"


def _raise(failures: list[Failure], what: str) -> None:
    if failures:
        raise DriverError(what, failures)
