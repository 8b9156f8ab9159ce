"""The process image: the slots of a connected machine, the operations on sensors (`readings.py`) and actuators
(`deliveries.py`), and the transfers between slots and drivers.

Slots are grouped in blocks, one for each driver and direction. A period makes one transfer per block, and converts its
values before or after the transfer (`conversion.py`). All transfers go through the transfer stage. Control code writes
directly into the image (`writes.py`), unless the column `restrictions`, which the claims set, requires the command
stage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import NoReturn

import numpy as np

from umo.cycle.clock import Clock
from umo.cycle.columns import Block, Source
from umo.cycle.conversion import send
from umo.cycle.to_defaults import Gate, ImageDefaults, Taken, ToDefault
from umo.cycle.writes import ImageWrites
from umo.drivers.contract import Direction
from umo.drivers.optional import WaitEnded
from umo.errors import FAILURES, DriverError, Failure, cause_of_failure, chained
from umo.objects import Quality
from umo.objects.linearization import Linearizations
from umo.objects.scaling import FloatArray, IntArray
from umo.wiring.wired import Wired

NO_SLOTS: Set[int] = frozenset()
"""No slots."""
NO_TICK = -1.0
"""The result of reading the timer if a stop has ended the wait."""


def raise_others(error: BaseException) -> None:
    """Raise an exception of a driver's call that is not a failure of the driver, such as a KeyboardInterrupt."""
    if not isinstance(error, FAILURES):
        raise error


def raise_failures(what: str, failures: Sequence[Failure]) -> NoReturn:
    raise chained(DriverError(what, failures))


class Image(ImageDefaults):
    """The slots of a connected machine, and the operations that transfer them."""

    writes: ImageWrites | None
    """The function through which control code writes; None if control code stores values directly."""
    write: Callable[[int, float], bool]
    before_tick: Callable[[], object] = staticmethod(bool)
    """Function that is called before the wait for a tick."""
    fail: Callable[[str, Sequence[Failure]], object] = staticmethod(raise_failures)
    """The function that is called with the objects that have failed, and with the failed operation. The function raises
    an error, unless equipment contains the failures of all these objects."""

    def __init__(self, wired: Wired, clock: Clock, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        super().__init__(wired, clock, equipment, axes, alarms)
        self.rates = wired.rates
        """The parts that do not have the machine's rate."""

    def connect(self, claims: Taken, commands: Gate, writes: ImageWrites | None) -> None:
        """Let the objects use this image from now on."""
        self.claims, self.commands, self.writes = claims, commands, writes
        self.write = self._store if writes is None else writes.write
        for slot, item in enumerate(self.items):
            item._connect(self, slot)

    def end(self) -> None:
        """Record that the machine stops: no period follows."""
        self.transfer.callees.end_absences()

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Replace every call of a driver by `instead`, which does not return."""
        self.segments.on_call = instead
        self.transfer.refuse(instead)

    def disconnect(self) -> None:
        for item in self.items:
            item._disconnect()

    # A whole period ------------------------------------------------------------------------------------

    def sample(self, blocks: Sequence[Block] | None = None) -> bool:
        """Read the sensors of these blocks (default: of all blocks), with one transfer for each block. A failure does
        not stop the other transfers."""
        failures: list[Failure] = []
        now = self.clock.now
        for block in self.inputs if blocks is None else blocks:
            block.view[:] = block.unread
            try:
                block.transfer(block.channels, block.buffer)
            except FAILURES as error:
                self._unread(block, error, failures)
            else:
                self._take(block, now, failures)
        if failures or self.sampled_good is None:
            return self._end_sample(failures)
        return self.sampled_good

    def sample_rest(self, blocks: Sequence[Block], place: int, error: BaseException | None) -> bool:
        """Read the blocks from this index on; the blocks before it were already transferred in this period. The
        transfer at the index has raised the error or, if there is no error, was not made yet."""
        failures: list[Failure] = []
        for block in blocks[:place]:
            self._take(block, self.clock.now, failures)
        if error is not None:
            raise_others(error)
            self._unread(blocks[place], error, failures)
            place += 1
        self.found += failures
        self.sampled_good = None  # so `sample` ends by looking at what was found
        return self.sample(blocks[place:])

    def _take(self, block: Block, now: float, failures: list[Failure]) -> None:
        """Store the values that the driver has read."""
        try:
            outside = block.convert(now)
        except Exception:  # of a linearization of the user's
            self.accept_each(block, {}, failures)
            return
        if outside or block.unsettled:
            self.settle_block(block, outside, now, failures)

    def _unread(self, block: Block, error: BaseException, failures: list[Failure]) -> None:
        """Handle the failed transfer of a block of inputs."""
        self.accept_each(block, dict(self.transfer.block_failed(block, error, inputs=True)), failures)

    def _end_sample(self, failures: list[Failure]) -> bool:
        """End a sample in which something fails or has failed before. Return True if all sampled sensors are GOOD."""
        what = "could not be read"
        if self.found:
            failures, self.found = [*self.found, *failures], []
        if self.unconfirmed and (unsent := self.send_again()):
            what = "could not be written or read"
            failures += unsent
        self._log_marked()
        if failures:
            self.fail(what, failures)
        good = not any(self.quality[self.sampled])
        self.sampled_good = None if self.unconfirmed else good
        return good

    def update(self, blocks: Sequence[Block] | None = None, dt: float | None = None) -> bool:
        """Send the actuators of these blocks (default: of all blocks), with one transfer for each block, whether or not
        they were written since the last period. `dt`: the time in s to which a slew rate applies; 0 means the time
        since the last step. Default: the time since the last period."""
        return self._send_each(self.outputs if blocks is None else blocks, self.clock.dt if dt is None else dt, [])

    def update_rest(self, blocks: Sequence[Block], place: int, error: BaseException | None) -> bool:
        """Send the blocks from this index on; the blocks before it were already sent in this period. The transfer at
        the index has raised the error or, if there is no error, was not made yet."""
        failures: list[Failure] = []
        if error is not None:
            raise_others(error)
            self._unsent(blocks[place], error, failures)
            place += 1
        return self._send_each(blocks[place:], self.clock.dt, failures)

    def _send_each(self, blocks: Sequence[Block], dt: float, failures: list[Failure]) -> bool:
        now = self.clock.now
        for block in blocks:
            unconverted: Set[int] = NO_SLOTS
            try:
                block.give(now, dt)
            except Exception:  # of a linearization of the user's
                unconverted = self.give_each(range(block.start, block.stop), failures)
            try:
                block.transfer(block.channels, block.buffer)
            except FAILURES as error:
                self._unsent(block, error, failures)
                continue
            block.commit(now)
            if block.unsettled:
                for slot in block.unsettled - unconverted:
                    self.set_quality(slot, Quality.GOOD)
                block.unsettled.intersection_update(unconverted)
        if failures:
            self.fail("could not be written", failures)
        return not failures

    def accept_each(self, block: Block, causes: Mapping[int, str], failures: list[Failure]) -> None:
        """Accept the readings of a block one by one, except those of the slots in `causes`, which failed."""
        self.fail_inputs(causes, failures)
        if len(causes) < block.stop - block.start:
            for slot, raw in zip(range(block.start, block.stop), block.view.tolist(), strict=True):
                if slot not in causes:
                    self.raws[slot] = raw
                    self.accept(slot, raw, failures)

    def _unsent(self, block: Block, error: BaseException, failures: list[Failure]) -> None:
        causes = dict(self.transfer.block_failed(block, error, inputs=False))
        for slot, raw in zip(range(block.start, block.stop), block.view.tolist(), strict=True):
            if slot in causes:
                self.fail_output(slot, causes[slot], failures)
            else:
                self.raws[slot] = raw
                self.accepted(slot)

    # Some objects --------------------------------------------------------------------------------------

    def read_now(self, slot: int) -> float:
        """Read an asynchronous sensor from the hardware now. Reading the timer advances the clock. Return `NO_TICK` if
        a stop has ended the wait for the tick."""
        failures: list[Failure] = []
        if slot == self.timer:
            self.before_tick()
        try:
            raw = self.transfer.read(slot)
        except (WaitEnded, *FAILURES) as error:
            return self.not_read(slot, error)
        if slot != self.timer:
            self.accept(slot, raw, failures)
        else:
            self._take_tick(raw, failures)
        self._end_read(failures)
        value: float = self.values[slot]
        return value

    def not_read(self, slot: int, error: BaseException) -> float:
        """Handle an error of reading a sensor from the hardware. Return the value for `read_now`."""
        if isinstance(error, WaitEnded):
            return NO_TICK
        raise_others(error)
        failures: list[Failure] = []
        self.fail_input(slot, cause_of_failure(error), failures)
        self._end_read(failures)
        value: float = self.values[slot]
        return value

    def ticked(self, raw: int) -> None:
        """Take over a reading of the timer that other code has made."""
        failures: list[Failure] = []
        self.raws[self.timer] = raw
        self._take_tick(raw, failures)
        self._end_read(failures)

    def _take_tick(self, raw: int, failures: list[Failure]) -> None:
        slot = self.timer
        if self._least_ticks <= raw <= self._most_ticks:
            self.clock.advance(raw)
            self.values[slot], self.times[slot] = raw, self.clock.now
            if self.quality[slot]:
                self.set_quality(slot, Quality.GOOD)
        else:  # the clock must not jump: every law and every timeout counts on it
            self.fail_input(slot, f"read {raw} missed periods, which is outside its range", failures)

    def _end_read(self, failures: list[Failure]) -> None:
        self._log_marked()
        if failures:
            self.fail("could not be read", failures)

    def sample_some(self, slots: Sequence[int]) -> bool:
        failures: list[Failure] = []
        for slot, found in self.transfer.read_some(slots):
            if isinstance(found, str):
                self.fail_input(slot, found, failures)
            else:
                self.accept(slot, found, failures)
        self._log_marked()
        if failures:
            self.fail("could not be read", failures)
        return all(self.quality[slot] == Quality.GOOD for slot in slots)

    def update_some(self, slots: Sequence[int]) -> bool:
        failures: list[Failure] = []
        unconverted: Set[int] = NO_SLOTS
        try:
            self._convert(slots)
        except Exception:  # of a linearization of the user's
            unconverted = self.give_each(slots, failures)
        ready = [slot for slot in slots if slot not in unconverted]
        for slot, cause in self.transfer.write_some(ready, self.columns.sent_raws):
            if cause is None:
                self.accepted(slot)
            else:
                self.fail_output(slot, cause, failures)
        if failures:
            self.fail("could not be written", failures)
        return not failures

    def _store(self, slot: int, value: float) -> bool:
        """Handle a written value that is within the range. With the extension, the extension does this instead."""
        if self.restrictions[slot]:
            return self.command(slot, value)
        self.pending[slot] = value
        return True

    def command(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """Handle a write within the range, by a client or to an actuator whose writes the command stage checks."""
        if source is Source.CLIENT and value != self._defaults[slot]:
            self.wires[slot].raw(value)  # a linearization of the user's that raises refuses the command
        if not self.commands.accept(slot, value, source):
            return False
        self.pending[slot] = value
        if failures := self.deliveries[slot].written(slot):
            self.fail("could not be written", failures)
            return False
        return True

    def go_on(self, slot: int, value: float) -> bool:
        """Write again a value that suspended work had written, so that it is sent in this period. Return True if the
        value was accepted."""
        taken = self.command(slot, value)
        self.does_not_wait(slot)
        return taken

    def write_many(self, slots: slice | IntArray, each: Sequence[int], values: FloatArray) -> bool:
        """Write many actuators in one call; the ranges were already checked. `each` lists the same slots, which are all
        synchronous or all asynchronous. Return True if all values were accepted and, for asynchronous actuators, also
        sent. An inhibited actuator is not changed."""
        if self.writes is None:
            if not np.count_nonzero(self.columns.restrictions[slots]):
                self.columns.pending[slots] = values
                return True
        elif self.writes.write_many(slots, values):  # asynchronous ones are restricted: they are asked
            return True
        free = self._ask_many(slots, each, values)
        if not self.deliveries[each[0]].at_once:
            return all(free)
        return self.update_some([slot for slot, taken in zip(each, free, strict=True) if taken]) and all(free)

    def _ask_many(self, slots: slice | IntArray, each: Sequence[int], values: FloatArray) -> list[bool]:
        """Return which of these writes the command stage accepts."""
        pending, writes = self.columns.pending, self.writes
        free = self.commands.accept_many(each, values)
        taken, before = np.array(free), pending[slots].copy()
        if writes is not None:
            for number in np.flatnonzero(taken).tolist():
                writes.note(each[number], before[number], values[number])
        pending[slots] = np.where(taken, values, before)
        return free

    def reset_some(self, slots: Iterable[int]) -> None:
        failures = [
            failure for slot, failure in self.settle(slots, ToDefault.RESET).items() if not self._resets_again(slot)
        ]
        if failures:
            self.fail("could not be reset", failures)

    def _resets_again(self, slot: int) -> bool:
        """Return True if a failed reset is not a failure yet, because the default is sent again in the next period."""
        if self.items[slot].direction is not Direction.OUTPUT or not self.deliveries[slot].is_sent_again(slot):
            return False
        self.owed.discard(slot)  # it is sent again as what is pending
        self.does_not_wait(slot)
        self.set_quality(slot, Quality.STALE)
        return True

    def _convert(self, slots: Sequence[int]) -> None:
        """Set the values that some actuators are sent next, limited by the rates since their last steps. Raises
        whatever a linearization of the user's raises."""
        linearizations = Linearizations([self.scales.linearizations[slot] for slot in slots])
        send(self.columns, self.scales, np.array(slots, np.int64), linearizations, self.clock.now, 0.0)

    def give_each(self, slots: Iterable[int], failures: list[Failure]) -> set[int]:
        """Encode the outputs of a block individually. Return the slots that failed; they keep their last sent
        values."""
        failed = set()
        for slot in slots:
            try:
                self._convert([slot])
            except Exception as error:
                self.unconverted(slot, error, failures)
                failed.add(slot)
        return failed
