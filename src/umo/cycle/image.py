"""The process image: flat sequences of raw integers and of values; an object holds its index, its slot.

Slots stand in blocks, one for each driver and direction, so that a period is one transfer a block. The forms
(`forms.py`) store the same numbers in lists or in arrays; all decisions are taken here. What moves goes through the
transfer stage, what is commanded of a guarded actuator through the command stage.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from math import nan
from typing import Any, cast

import numpy as np

from umo.cycle.block import Block
from umo.cycle.clock import Clock
from umo.cycle.commands import Command, Commands, Source
from umo.cycle.transfer import FAILURES, Transfer, cause_of_failure
from umo.drivers.contract import UNREAD, Direction, WaitEnded
from umo.errors import BadInput, DriverError, Failure
from umo.objects import Binary, BinaryActuator, BinarySensor, DigitalActuator, DigitalSensor, Quality
from umo.objects.atomic import Digital
from umo.objects.scaling import FloatArray, IntArray, to_raw, to_value
from umo.wiring.resolved import Wire, Wired

log = logging.getLogger("umo")
TELL_AGAIN = 10.0
"""Time in s for which a sensor that is marked BAD again is not logged again."""
NO_TICK = -1.0
"""Result of reading the timer when a stop has ended the wait."""
Actuator = BinaryActuator[Any] | DigitalActuator
Sensor = BinarySensor[Any] | DigitalSensor


class Image(ABC):
    """The common part of the forms. Slot order: sampled inputs, updated outputs, then the asynchronous objects."""

    values: Any
    pending: Any
    quality: Any
    times: Any

    def __init__(self, wired: Wired, clock: Clock) -> None:
        self.clock = clock
        self.wires = sorted(wired.wires, key=_group_order(wired.wires))
        self.items = [wire.item for wire in self.wires]
        self.wire_texts: Sequence[str] = [wired.text_of(wire) for wire in self.wires]
        self.slot_of = {id(item): slot for slot, item in enumerate(self.items)}
        self.timer = -1 if wired.timer is None else self.slot_of[id(wired.timer)]
        self.transfer = Transfer(self.wires, wired, self.timer)
        self._least_ticks, self._most_ticks = self.wires[self.timer].raw_bounds if wired.timer is not None else (0, 0)
        self.commands: Commands
        self._marked: list[Failure] = []
        """Sensors that were marked BAD and not logged yet."""
        self._tell_again: dict[int, float] = {}
        self._slewing: list[Command]
        count = len(self.wires)
        self.raws: Any = self.transfer.raws
        self.pending_raws_array = np.zeros(count, np.int64)
        self.pending_raws: Any = self.pending_raws_array.data
        self.scales = [(*wire.scale, *wire.bounds) for wire in self.wires]
        self.linearizations = [wire.linearization for wire in self.wires]
        self.invalid_raws = {slot: raws for slot in range(count) if (raws := self._invalid(slot))}
        self.base = [
            Quality.UNREFERENCED if isinstance(item, DigitalSensor) and item.incremental else Quality.GOOD
            for item in self.items
        ]
        self._exact = [
            item.direction is Direction.INPUT or wire.exact for item, wire in zip(self.items, self.wires, strict=True)
        ]
        self._raw_bounds = None if all(self._exact) else np.array([wire.raw_bounds for wire in self.wires]).T
        self._make(count)
        self.inputs = self._blocks(Direction.INPUT)
        self.outputs = self._blocks(Direction.OUTPUT)
        self.transfer.bind(self.inputs, self.outputs)
        self.sampled_good: bool | None = None
        """Whether all of `sampled` are GOOD; None: a quality has changed since the last check."""
        self.sampled = slice(0, self.inputs[-1].stop if self.inputs else 0)
        for block in self.inputs:
            self._prepare_input(block)
        for block in self.outputs:
            self._prepare_output(block)
        for slot, item in enumerate(self.items):
            if item.direction is Direction.OUTPUT:
                self._set_quality(slot, Quality.GOOD)
                self.set_default(slot)
            else:
                self.values[slot] = nan  # nothing was read yet
                self._set_quality(slot, Quality.BAD)

    def connect(self, commands: Commands) -> None:
        """The objects find their values here from now on."""
        self.commands = commands
        self._slewing = commands.slewing
        for slot, item in enumerate(self.items):
            item._connect(self, slot, self._is_direct(slot))

    def _is_direct(self, slot: int) -> bool:
        """Whether the object writes to the image without the command stage."""
        plain = self._exact[slot] and self.linearizations[slot] is None
        return self.items[slot].synchronous and slot not in self.commands.by_slot and plain

    def guard(self, slot: int) -> None:
        """The actuator has a command from now on, or has none any longer."""
        self.items[slot]._direct = self._is_direct(slot)

    def disconnect(self) -> None:
        for item in self.items:
            item._disconnect()

    # What the forms do differently ---------------------------------------------------------------------

    @abstractmethod
    def _make(self, count: int) -> None:
        """Make the sequences `values`, `pending`, `quality` and `times`."""

    @abstractmethod
    def _prepare_input(self, block: Block) -> None:
        """Set `convert` of an input block, also when a scale has changed. A raw that the circuit reports as invalid
        gives a value that is out of bounds."""

    def _prepare_output(self, block: Block) -> None:
        """Set `commit` of an output block."""
        block.commit = partial(self._commit, block)

    @abstractmethod
    def _commit(self, block: Block, now: float) -> None:
        """As `Block.commit`."""

    @abstractmethod
    def _stamp(self, block: Block, now: float) -> None: ...

    @abstractmethod
    def put_pending(self, slots: slice | IntArray, values: FloatArray, raws: IntArray) -> None:
        """Many written at once; the values were checked."""

    @abstractmethod
    def get_values(self, slots: slice | IntArray) -> FloatArray:
        """A new array."""

    # A whole period ------------------------------------------------------------------------------------

    def sample(self) -> bool:
        """Read every synchronous sensor, one transfer per driver. A failure does not stop the others."""
        failures: list[Failure] = []
        now = self.clock.now
        for block in self.inputs:
            block.view[:] = block.unread
            try:
                block.transfer(block.channels, block.buffer)
            except FAILURES as error:
                self._sample_rest(block, error, now, failures)
                continue
            outside = block.convert(now)
            if outside or block.unsettled:
                self._settle(block, outside, now, failures)
        if failures or self.sampled_good is None:
            self._tell_marked()
            if failures:
                raise DriverError("could not be read", failures)
            self.sampled_good = not any(self.quality[self.sampled])
        return self.sampled_good

    def update(self) -> bool:
        """Send every synchronous actuator, written or not since the last period; one transfer per driver."""
        if self._slewing:
            self.commands.slew()
        failures: list[Failure] = []
        now = self.clock.now
        for block in self.outputs:
            try:
                block.transfer(block.channels, block.buffer)
            except FAILURES as error:
                self._update_rest(block, error, failures)
                continue
            block.commit(now)
            if block.unsettled:
                for slot in block.unsettled:
                    self._set_quality(slot, Quality.GOOD)
                block.unsettled.clear()
        if self._slewing:
            self.commands.aim()
        if failures:
            raise DriverError("could not be written", failures)
        return True

    def _sample_rest(self, block: Block, error: BaseException, now: float, failures: list[Failure]) -> None:
        """A block of which at least some failed: the others stand."""
        causes = dict(self.transfer.block_failed(block, error, inputs=True))
        for slot, raw in zip(range(block.start, block.stop), block.view, strict=True):
            if slot in causes:
                self._fail_input(slot, causes[slot], failures)
            else:
                self.raws[slot] = raw
                self._accept(slot, raw, failures)

    def _update_rest(self, block: Block, error: BaseException, failures: list[Failure]) -> None:
        causes = dict(self.transfer.block_failed(block, error, inputs=False))
        for slot in range(block.start, block.stop):
            if slot in causes:
                self._fail_output(slot, causes[slot], failures)
            else:
                self.raws[slot] = self.pending_raws[slot]
                self._accepted(slot)

    # Some objects --------------------------------------------------------------------------------------

    def read_now(self, slot: int) -> float:
        """Read an asynchronous sensor from the hardware, now. Reading the timer advances the clock; `NO_TICK` if a stop
        has ended the wait for its tick."""
        failures: list[Failure] = []
        try:
            raw = self.transfer.read(slot)
        except WaitEnded:
            return NO_TICK
        except FAILURES as error:
            self._fail_input(slot, cause_of_failure(error), failures)
        else:
            if slot != self.timer:
                self._accept(slot, raw, failures)
            elif self._least_ticks <= raw <= self._most_ticks:
                self.clock.advance(raw)
                self._accept(slot, raw, failures)
            else:  # the clock must not jump: every law and every timeout counts on it
                self._fail_input(slot, f"read {raw} missed periods, which is outside its range", failures)
        self._tell_marked()
        if failures:
            raise DriverError("could not be read", failures)
        value: float = self.values[slot]
        return value

    def sample_some(self, slots: Sequence[int]) -> bool:
        failures: list[Failure] = []
        for slot, found in self.transfer.read_some(slots):
            if isinstance(found, str):
                self._fail_input(slot, found, failures)
            else:
                self._accept(slot, found, failures)
        self._tell_marked()
        if failures:
            raise DriverError("could not be read", failures)
        return all(self.quality[slot] == Quality.GOOD for slot in slots)

    def update_some(self, slots: Sequence[int]) -> bool:
        self.commands.slew(slots)
        failures: list[Failure] = []
        for slot, cause in self.transfer.write_some(slots, self.pending_raws_array):
            if cause is None:
                self._accepted(slot)
            else:
                self._fail_output(slot, cause, failures)
                self.commands.failed(slot)
        self.commands.aim()
        if failures:
            raise DriverError("could not be written", failures)
        return True

    def command(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """A value within its range was written to an actuator that is guarded, or asynchronous, or whose range ends
        between two raw integers; or by a hand."""
        if not self.commands.take(slot, value, source):
            return False
        self.pending[slot] = value
        self.pending_raws[slot] = self.wires[slot].raw(value)
        if not self.items[slot].synchronous and (failures := self.try_send(slot)):
            raise DriverError("could not be written", failures)
        return True

    def try_send(self, slot: int) -> list[Failure]:
        """Send the pending value of one actuator to the hardware, now."""
        failures: list[Failure] = []
        try:
            self.transfer.write(slot, self.pending_raws[slot])
        except FAILURES as error:
            self._fail_output(slot, cause_of_failure(error), failures)
            self.commands.failed(slot)
        else:
            self._accepted(slot)
        return failures

    def write_many(self, slots: slice | IntArray, each: Sequence[int], values: FloatArray, raws: IntArray) -> bool:
        """Many written at once; their ranges were checked. `each` lists the same slots. Whether all were taken: an
        actuator that is inhibited stays as it is."""
        if self._raw_bounds is not None:
            raws = np.clip(raws, *self._raw_bounds[:, slots])
        if not self.commands.by_slot:
            self.put_pending(slots, values, raws)
            return True
        taken = self.commands.take_many(each, values)
        if all(taken):
            self.put_pending(slots, values, raws)
            return True
        free = np.array(taken)
        self.put_pending(np.array(each)[free], values[free], raws[free])
        return False

    def reset_some(self, slots: Iterable[int]) -> None:
        failures = [failure for _, failure in self.reset_each(slots) if failure is not None]
        if failures:
            raise DriverError("could not be reset", failures)

    def reset_each(self, slots: Iterable[int]) -> Iterator[tuple[int, Failure | None]]:
        """The driver's reset for each; one failure never stops the rest."""
        slots = list(slots)
        for slot in slots:
            self._at_default(slot)
        for slot, failure in self.transfer.bring_to_default(slots):
            self._was_reset(slot, failure)
            yield slot, failure

    def initialize(self, slot: int) -> Failure | None:
        self._at_default(slot)
        failure = self.transfer.initialize(slot)
        self._was_reset(slot, failure)
        return failure

    def _at_default(self, slot: int) -> None:
        if self.items[slot].direction is Direction.OUTPUT:
            self.set_default(slot)
            self.commands.rest(slot)

    def _was_reset(self, slot: int, failure: Failure | None) -> None:
        if failure is not None:
            self._set_quality(slot, Quality.BAD)
            self.commands.failed(slot)
        elif self.items[slot].direction is Direction.OUTPUT:
            self._accepted(slot)

    def set_reading(self, slot: int, value: float) -> None:
        """Change the zero offset of a digital sensor so that its last reading is this value."""
        item = cast(Digital, self.items[slot])
        if self.quality[slot] == Quality.BAD:
            raise BadInput(item.path, Quality.BAD)
        resolution, before, low, high = self.scales[slot]
        raw = to_raw(self.values[slot], resolution, before)  # `raws` may be of a reading that failed
        zero_offset = value - raw * resolution
        item._calibrate(item.calibration._replace(zero_offset=zero_offset))
        self.scales[slot] = resolution, zero_offset, low, high
        self.values[slot] = to_value(raw, resolution, zero_offset)
        for block in self.inputs:
            if block.start <= slot < block.stop:
                self._prepare_input(block)

    def set_referenced(self, slot: int, referenced: bool) -> None:
        self.base[slot] = Quality.GOOD if referenced else Quality.UNREFERENCED
        item, quality = cast(Sensor, self.items[slot]), self.quality[slot]
        held = item._max_age is not None and item.synchronous and self.times[slot] < self.clock.now
        if quality != Quality.BAD and not (held and referenced):
            self._set_quality(slot, self._judge(slot, self.values[slot]))
        elif quality == Quality.UNREFERENCED:  # the held value is referenced from now on, but it is still old
            self._set_quality(slot, Quality.STALE)

    # Inside --------------------------------------------------------------------------------------------

    def _settle(self, block: Block, outside: list[tuple[int, float]], now: float, failures: list[Failure]) -> None:
        """The slow path of `sample`: something in the block is, or was, not as it should be."""
        failed = {slot: (cause, self.times[slot]) for slot, _ in outside if (cause := self._refused(slot))}
        for slot in block.unsettled - failed.keys():
            self._set_quality(slot, self.base[slot])
        block.unsettled &= failed.keys()
        for slot, value in outside:
            if slot not in failed:
                self.values[slot] = value
                self._set_quality(slot, self._judge(slot, value))
        self._stamp(block, now)
        for slot, (cause, time) in failed.items():
            self.times[slot] = time
            self._fail_input(slot, cause, failures)

    def _invalid(self, slot: int) -> tuple[int, ...]:
        """The raw integers that are not readings: those of the wiring, and the mark of a place that was not read where
        it would lie within the range."""
        _, _, low, high = self.scales[slot]
        unread = (UNREAD,) if low <= self.value_of(slot, UNREAD) <= high else ()
        return (*self.wires[slot].invalid_raws, *unread)

    def _refused(self, slot: int) -> str:
        """Why its raw value, which is in `raws`, is not a reading; empty if it is one."""
        raw = self.raws[slot]
        if raw == UNREAD:
            return "the driver returned fewer values than channels"
        if isinstance(self.items[slot], Binary):
            return "" if raw in (0, 1) else f"read {raw}, but a binary channel reads 0 or 1"
        return f"the circuit reports an invalid reading (raw {raw})" if raw in self.invalid_raws.get(slot, ()) else ""

    def _accept(self, slot: int, raw: int, failures: list[Failure]) -> None:
        """One sensor was read."""
        value = self.value_of(slot, raw)
        _, _, low, high = self.scales[slot]
        inside = low <= value <= high
        if (slot in self.invalid_raws or not inside) and (cause := self._refused(slot)):
            self._fail_input(slot, cause, failures)
            return
        self.values[slot] = value
        self.times[slot] = self.clock.now
        if not inside or self.quality[slot] != self.base[slot]:
            self._set_quality(slot, self._judge(slot, value))

    def value_of(self, slot: int, raw: int) -> float:
        """The value that a raw integer stands for."""
        resolution, zero_offset, _, _ = self.scales[slot]
        value = to_value(raw, resolution, zero_offset)
        linearization = self.linearizations[slot]
        return value if linearization is None else linearization.to_value(value)

    def _judge(self, slot: int, value: float) -> Quality:
        _, _, low, high = self.scales[slot]
        if self.base[slot] is not Quality.GOOD or low <= value <= high:
            return self.base[slot]
        return Quality.OUT_OF_RANGE

    def _accepted(self, slot: int) -> None:
        """One actuator's pending value is at the hardware."""
        self.values[slot] = self.pending[slot]
        self.times[slot] = self.clock.now
        if self.quality[slot]:
            self._set_quality(slot, Quality.GOOD)
            self.commands.unsent.discard(slot)

    def _fail_input(self, slot: int, cause: str, failures: list[Failure]) -> None:
        item = cast(Sensor, self.items[slot])
        age = self.clock.now - self.times[slot]  # NaN before the first reading
        if item._max_age is not None and age <= item._max_age:
            if self.quality[slot] == Quality.GOOD:  # what was not good is no better for being held
                self._set_quality(slot, Quality.STALE)
        elif item._marks:
            if self.quality[slot] != Quality.BAD:
                self._set_quality(slot, Quality.BAD)
                if self.clock.now >= self._tell_again.get(slot, 0.0):
                    self._tell_again[slot] = self.clock.now + TELL_AGAIN
                    self._marked.append(self.transfer.failure(slot, cause))
        else:
            self._fail_output(slot, cause, failures)

    def _tell_marked(self) -> None:
        """Log together what was marked BAD together: a thousand lines would take longer than a period."""
        if self._marked:
            log.warning("%s", DriverError("marked BAD", self._marked))
            self._marked = []

    def _fail_output(self, slot: int, cause: str, failures: list[Failure]) -> None:
        self._set_quality(slot, Quality.BAD)
        failures.append(self.transfer.failure(slot, cause))

    def _set_quality(self, slot: int, quality: Quality) -> None:
        self.quality[slot] = int(quality)
        self.sampled_good = None
        if quality is not self.base[slot]:
            for block in (*self.inputs, *self.outputs):
                if block.start <= slot < block.stop:
                    block.unsettled.add(slot)

    def set_default(self, slot: int) -> None:
        """Its default is pending."""
        self.pending[slot] = cast(Actuator, self.items[slot])._default_value()
        self.pending_raws[slot] = self.transfer.defaults[slot]

    def _blocks(self, direction: Direction) -> list[Block]:
        inputs = direction is Direction.INPUT
        slots = [s for s, item in enumerate(self.items) if item.synchronous and item.direction is direction]
        blocks = []
        for driver, group in self.transfer.by_driver(slots):
            start, stop = group[0], group[-1] + 1
            buffer = np.zeros(len(group), np.int64) if inputs else self.pending_raws_array[start:stop]
            buffer.flags.writeable = inputs  # what is pending is not the driver's to change
            blocks.append(Block(driver, tuple(self.wires[slot].channel for slot in group), start, buffer))
        return blocks


def _group_order(wires: Sequence[Wire]) -> Any:
    """Sampled inputs, updated outputs, asynchronous; within each by driver, then as declared."""
    drivers: dict[int, int] = {}
    for wire in wires:
        drivers.setdefault(id(wire.driver), len(drivers))

    def key(wire: Wire) -> tuple[bool, bool, int]:
        return not wire.item.synchronous, wire.item.direction is Direction.OUTPUT, drivers[id(wire.driver)]

    return key
