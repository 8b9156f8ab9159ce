"""The sensors of the image: the handling of readings. An invalid reading is refused. Any other reading is conditioned,
and its quality depends on its range and on whether the sensor is referenced. If a reading fails, the failure is
reported, or the last value is held, or the sensor is marked BAD.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Protocol, cast

from umo.cycle.clock import Clock
from umo.cycle.columns import Block
from umo.cycle.conditioning import ConditionedInputs, conditioner_of
from umo.cycle.conversion import convert_inputs
from umo.cycle.slots import Slots
from umo.cycle.transfer import Transfer
from umo.drivers.contract import UNREAD, Direction
from umo.errors import BadInput, DriverError, Failure, RangeError, cause_of_failure
from umo.objects import Digital, Quality, Sensor
from umo.objects.scaling import to_value
from umo.wiring.wired import Wired

MARKED_LOG_INTERVAL = 10.0
"""The least time in s between two lines of the log about one sensor that is marked BAD."""
MAX_OFFSET_RAW = 2.0**62
"""Largest zero offset that is accepted, in raw integers."""


class Elsewhere(Protocol):
    """The circuits whose values arrive independently of the period (`umo.cycle.off_cycle`)."""

    def read_at(self, slot: int) -> float:
        """Return the time in s of the reading that is being accepted."""

    def was_read(self, slot: int, failures: list[Failure]) -> None:
        """Record that a reading with a time of its own was accepted."""


class ImageInputs(Slots):
    """The slots of a machine's objects, and the operations on the sensors among them."""

    def __init__(self, wired: Wired, clock: Clock, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        super().__init__(wired, clock, equipment, axes, alarms)
        self._low, self._high = self.scales.low.data, self.scales.high.data
        self.elsewhere: dict[int, Elsewhere] = {}
        """The circuits whose values arrive independently of the period, by sensor."""
        self.found: list[Failure] = []
        """Failures since the last sample; the next sample reports them."""
        self.failed: set[int] = set()
        """The sensors that failed and have not been initialised since."""
        self._marked: list[tuple[int, str]] = []
        """Failures of the sensors that were marked BAD and not logged yet."""
        self._next_log: dict[int, float] = {}
        """The time in s from which on a marked sensor is logged again, by slot."""
        sensors = (slot for slot, item in enumerate(self.items) if item.direction is Direction.INPUT)
        self.invalid_raws = {slot: raws for slot in sensors if (raws := self._invalid(slot))}
        found = ((slot, conditioner_of(wire)) for slot, wire in enumerate(self.wires))
        self.conditioners = {slot: each for slot, each in found if each is not None}
        """The conditioners, by the slots of their sensors."""
        for block in self.blocks:
            if block.stop <= self.sampled.stop:
                self._prepare(block)

    def _prepare(self, block: Block) -> None:
        """Prepare the conversion of an input block. A raw integer that marks an invalid reading gives a value that is
        out of bounds."""
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

    def set_reading(self, slot: int, value: float) -> None:
        """Change the zero offset of a digital sensor so that its last reading has this value."""
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
            raise RangeError(f"{item.path}: {value:g} {item.units} is not a position that it can have")
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

    def _is_inside(self, slot: int, value: float) -> bool:
        """Return True if a value of this sensor is within the bounds of GOOD values."""
        return self._low[slot] <= value <= self._high[slot]

    def _judge(self, slot: int, value: float) -> Quality:
        if self.base[slot] is not Quality.GOOD or self._is_inside(slot, value):
            return self.base[slot]
        return Quality.OUT_OF_RANGE

    def settle_block(
        self, block: Block, outside: Sequence[tuple[int, float]], now: float, failures: list[Failure]
    ) -> None:
        """Accept a block in which the quality of a slot is, or was, not the normal one. This is the slow path of
        `sample`."""
        failed = {slot: (cause, self.times[slot]) for slot, _ in outside if (cause := self._refused(slot))}
        for slot in block.unsettled - failed.keys():
            self.set_quality(slot, self.base[slot])
        block.unsettled.intersection_update(failed)
        for slot, value in outside:
            if slot not in failed:
                self.values[slot] = value
                self.set_quality(slot, self._judge(slot, value))
        self.columns.times[block.slots] = now
        for slot, (cause, time) in failed.items():
            self.times[slot] = time
            self.fail_input(slot, cause, failures)

    def _invalid(self, slot: int) -> tuple[int, ...]:
        """Return the raw integers that are not readings: those of the wiring, and UNREAD (the mark for a value that was
        not read) if UNREAD would lie within the sensor's range."""
        unread = (UNREAD,) if self._is_inside(slot, self.value_of(slot, UNREAD)) else ()
        return (*self.wires[slot].invalid_raws, *unread)

    def _read_at(self, slot: int) -> float:
        """Return the time in s of the reading that is being accepted."""
        elsewhere = self.elsewhere.get(slot)
        return self.clock.read() if elsewhere is None else elsewhere.read_at(slot)

    def velocity(self, slot: int) -> float:
        """Return the velocity of a sensor in units per s. Raises BadInput while it is BAD."""
        if self.quality[slot] == Quality.BAD:
            raise BadInput(self.items[slot].path, Quality.BAD)
        return self.conditioners[slot].velocity

    def _is_refused(self, slot: int, raw: int) -> bool:
        """Return True if a raw integer is not a reading."""
        if (levels := self.items[slot]._raws) is not None:
            return raw not in levels
        return raw in self.invalid_raws.get(slot, ()) or raw == UNREAD

    def _refused(self, slot: int) -> str:
        """Return why a raw value in `raws` is not a reading; empty if it is one."""
        raw = self.raws[slot]
        if raw == UNREAD:
            return "the driver returned fewer values than channels"
        if (levels := self.items[slot]._raws) is not None and raw not in levels:
            return f"read {raw}, but a {self.items[slot]._word} channel reads {' or '.join(map(str, levels))}"
        return f"the circuit reports an invalid reading (raw {raw})" if raw in self.invalid_raws.get(slot, ()) else ""

    def accept(self, slot: int, raw: int, failures: list[Failure]) -> None:
        """Store the reading of one sensor."""
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
        """Mark many readings as failed, such as all readings of a driver."""
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
        """Log all readings that were marked BAD in one line, because a thousand lines would take longer than a
        period."""
        if self._marked:
            self.events.log(partial(_marked_text, self.transfer, self._marked))
            self._marked = []


def _marked_text(transfer: Transfer, marked: Sequence[tuple[int, str]]) -> str:
    return str(DriverError("marked BAD", [transfer.failure(slot, cause) for slot, cause in marked]))
