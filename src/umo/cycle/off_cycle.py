"""The process image of a machine that has drivers off the cycle (`umo.drivers.off_cycle`).

Their values arrive at times of their own, each with its stamp: the time at which the transfer began that brought it.
Age alone decides: a value older than the driver's `max_age` is STALE, one older than twice that has failed, as its
object's `on_error` says. So one failed transfer of a slow device is no failure, and whatever a worker process suffers,
no old value looks fresh. Outputs are posted in each period; `read` gives what the device has confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from umo.cycle.clock import Clock
from umo.cycle.columns import Block
from umo.cycle.events import Event, EventLimit, limited
from umo.cycle.image import Image
from umo.cycle.journal import ErrorKind, Kind
from umo.cycle.transfer import cause_of_failure
from umo.drivers.contract import Direction
from umo.drivers.off_cycle import NEVER, OffCycle
from umo.drivers.off_cycle.device_server import LONG_ABSENCE
from umo.drivers.off_cycle.proxy import generation_of
from umo.drivers.off_cycle.shared_memory import Cell, Row
from umo.errors import Failure
from umo.objects import Quality
from umo.objects.scaling import FloatArray, IntArray
from umo.presentation.durations import duration
from umo.text import some
from umo.wiring.wired import Wired

if TYPE_CHECKING:
    from umo.cycle.period import Period

BAD_AGES = 2
"""Number of maximum ages after which a value has failed."""


class Remote:
    """One driver off the cycle, as the image meets it. A channel's place is its number in the exchange."""

    def __init__(self, image: Image, name: str, driver: OffCycle) -> None:
        self.driver = driver
        self.path = f"driver {name}"
        """What its events are of."""
        slots = [slot for slot, wire in enumerate(image.wires) if wire.driver is driver]
        self.place = {slot: driver.exchange.place[image.wires[slot].channel.text] for slot in slots}
        """The place of each slot's channel."""
        mine = [block for block in image.blocks if block.driver is driver]
        self.inputs = [block for block in mine if block in image.inputs]
        self.outputs = [block for block in mine if block in image.outputs]
        self.watched = np.array([slot for slot in slots if image.items[slot].synchronous], np.int64)
        """The slots whose ages are watched: those that are transferred in each of its periods."""
        self.arrived = -1
        """The count of transfers up to which the image has taken the values."""
        self.rows = driver.exchange.arrivals.read()[1]
        """What was taken last."""
        self.until = -np.inf
        """Time in s up to which no value becomes too old."""
        self.stamps = np.full(len(driver.exchange.channels), NEVER)
        self.times: FloatArray = np.full(len(self.stamps), np.nan)
        """Time of each channel's value in s on the cycle's clock, by place."""
        self.awaited: dict[int, tuple[int, float]] = {}
        """Asynchronous actuators whose last order is not carried out yet: its number, and the time in s of the first
        one that was not."""
        self.told_away = False
        """Whether it counts as away, since no value came for long."""
        self.tells_end = False
        """Whether that was told, so that its end is to be told."""
        self.told_again = False
        """Whether an initialisation was told since."""
        self.limits = {text: EventLimit() for text in ("away", "initialised")}
        self.last = 0.0
        """Time in s at which a value was taken last."""


class OffCycleImage(Image):
    """The image of a machine with drivers off the cycle."""

    def __init__(self, wired: Wired, clock: Clock, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        super().__init__(wired, clock, equipment, axes, alarms)
        drivers = [(name, driver) for name, driver in wired.drivers.items() if isinstance(driver, OffCycle)]
        self._remotes = [Remote(self, name, driver) for name, driver in drivers]
        self._remote_of = {slot: remote for remote in self._remotes for slot in remote.place}
        off = {id(remote.driver) for remote in self._remotes}
        self.inputs = [block for block in self.inputs if id(block.driver) not in off]
        self.outputs = [block for block in self.outputs if id(block.driver) not in off]
        self.transfer.bind(self.inputs, self.outputs)
        self._failures: list[Failure] = []
        self._beginning = False
        """Whether the worker has just initialised these objects."""
        self._updated = False
        """Whether what the outputs are to be was not posted yet."""
        self._faults = wired.injection
        workers = any(remote.driver.worker is not None for remote in self._remotes)
        self._ns: Callable[[], int] = monotonic_ns if workers else self._machine_ns
        self._now_ns = self._ns()
        """The time in ns of the last sample, which is `clock.now`."""
        for remote in self._remotes:
            if remote.driver.worker is None:
                remote.driver.server.ns = self._machine_ns
            if self._faults is not None:
                remote.driver.fault_time = self._fault_time

    def _machine_ns(self) -> int:
        return round(self.clock.now * 1e9)

    def _fault_time(self) -> int:
        assert self._faults is not None
        return NEVER if self._faults.clock is None else self._machine_ns()

    def begin(self) -> None:
        """From now on no call of these drivers waits."""
        for remote in self._remotes:
            self.transfer.on_call()
            remote.driver.begin()
        self._now_ns = self._ns()
        self._exchange()

    def end(self) -> None:
        """The machine stops: each call is made, and waits."""
        super().end()
        for remote in self._remotes:
            remote.driver.end()

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        super().refuse(instead)
        for remote in self._remotes:
            remote.driver.refuse(instead)

    # A whole period ------------------------------------------------------------------------------------

    def read_now(self, slot: int) -> float:
        """Before the wait for the next tick there is time for what these drivers exchange: it delays no output."""
        if slot == self.timer:
            self._exchange()
        return super().read_now(slot)

    def attach(self, period: Period) -> None:
        period.receiving.append(self._receive)

    def _receive(self) -> None:
        """Judge whether what has arrived is too old."""
        if self.timer < 0:
            self._exchange()
        now = self.clock.now
        self._now_ns = self._ns()
        for remote in self._remotes:
            if now > remote.until:
                self._judge_ages(remote, now)
            if remote.awaited:
                self._look_at_orders(remote, now)
        if self._failures:
            self.sampled_good = None

    def _end_sample(self, failures: list[Failure]) -> bool:
        mine, self._failures = self._failures, []
        return super()._end_sample([*mine, *failures])

    def update(self, blocks: Sequence[Block], dt: float | None = None) -> bool:
        """What these outputs are to be is posted before the next tick; the others are sent."""
        self._updated = True
        return super().update(blocks, dt)

    def _exchange(self) -> None:
        """Post what the outputs are to be, take what has arrived."""
        now, updated, self._updated = self.clock.now, self._updated, False
        for remote in self._remotes:
            driver = remote.driver
            if not driver.running:
                continue
            if updated:
                for block in remote.outputs:
                    self._post(remote, block, now)
            if self._faults is not None:
                driver.exchange.cells[Cell.NOW] = self._fault_time()
            if driver.worker is None:
                driver.server.work()
            if driver.exchange.arrivals.count != remote.arrived:
                self._take(remote, now)

    def _post(self, remote: Remote, block: Block, now: float) -> None:
        """A rate counts from what was confirmed."""
        confirmed = float(self.columns.times[block.slots].max())
        try:
            block.give(now, min(now - confirmed, remote.driver.max_age))
        except Exception:  # of a linearization of the user's
            self._give_each(range(block.start, block.stop), self._failures)
        remote.driver.write_many(block.channels, block.buffer)

    # What arrives --------------------------------------------------------------------------------------

    def _take(self, remote: Remote, now: float) -> None:
        """A transfer of the worker's is complete: its values, with their times."""
        driver = remote.driver
        remote.arrived, remote.rows = driver.exchange.arrivals.read()
        rows = driver.read_rows = remote.rows
        if generation_of(rows) != driver.generation:
            self._begin_generation(remote)
        arrived = self._date(remote, rows[Row.STAMP], now)
        for block in remote.inputs:
            self._convert_arrivals(remote, block, rows, now)
        for block in remote.outputs:
            self._confirm(remote, block, rows)
        remote.until = -np.inf
        if remote.told_away and arrived and driver.exchange.cells[Cell.AWAY_SINCE] == NEVER:
            remote.told_away = remote.told_again = False
            if remote.tells_end:
                self.events.add(Event(now, remote.path, "is back"), logged=True)

    def _date(self, remote: Remote, stamps: IntArray, now: float) -> bool:
        """Whether a value has come that was not there before."""
        new = np.flatnonzero(stamps != remote.stamps)
        if not new.size:
            return False
        remote.times[new] = remote.driver.times(new, stamps[new], now, self._now_ns)
        remote.stamps = stamps.copy()
        arrived = bool((stamps[new] != NEVER).any())
        if arrived:
            remote.last = now
        return arrived

    def _convert_arrivals(self, remote: Remote, block: Block, rows: IntArray, now: float) -> None:
        places = remote.driver.places(block.channels)
        block.buffer[:] = raws = rows[Row.RAW, places]
        before = self.columns.raws[block.slots].copy()
        if block.conditioned is not None:
            block.conditioned.stamps = remote.times[places]
        try:
            outside = block.convert(now)
        except Exception:  # of a linearization of the user's
            self._accept_each(block, {}, self._failures)
        else:
            if outside or block.unsettled:
                self._settle(block, outside, now, self._failures)
        times = self.columns.times[block.slots]
        stamped = remote.times[places]
        times[:] = np.where(times == now, stamped, times)  # what failed keeps the time of its last value
        never = np.isnan(stamped)
        if never.any():
            self.columns.values[block.slots][never] = np.nan
            times[never] = np.nan
        self._note(Kind.ARRIVED, block, raws, before, stamped)

    def _note(self, kind: Kind, block: Block, raws: IntArray, before: IntArray, times: FloatArray) -> None:
        """What has arrived is in the journal with its time: with these a recording can be replayed."""
        journal = self.transfer.journal
        if journal is not None:
            journal.add_rows(range(block.start, block.stop), kind, raws, before, times=times)

    def _confirm(self, remote: Remote, block: Block, rows: IntArray) -> None:
        """What the device has accepted, as it was given; what is older than that by its raw integer."""
        columns, slots = self.columns, block.slots
        places = remote.driver.places(block.channels)
        raws, times = rows[Row.RAW, places], remote.times[places]
        same = raws == columns.sent_raws[slots]
        columns.values[slots] = np.where(same, columns.sent[slots], columns.values[slots])
        for number in np.flatnonzero(~same & (raws != columns.raws[slots])).tolist():
            slot = block.start + number
            try:
                self.values[slot] = self.value_of(slot, int(raws[number]))
            except Exception as error:  # of a linearization of the user's
                self._fail_output(slot, f"its linearization failed: {cause_of_failure(error)}", self._failures)
        self._note(Kind.CONFIRMED, block, raws, columns.raws[slots], times)
        columns.raws[slots] = raws
        newer = times > columns.times[slots]
        columns.times[slots] = np.where(newer, times, columns.times[slots])
        for slot in tuple(block.unsettled):
            if newer[slot - block.start]:
                block.unsettled.discard(slot)
                self._set_quality(slot, Quality.GOOD)

    def _begin_generation(self, remote: Remote) -> None:
        """The outputs were initialised again, by the worker or by the one that has taken its place."""
        self.transfer.note(next(iter(remote.place)), Kind.RENEWED)
        remote.awaited.clear()
        lost = [path for slot in remote.place if (path := self.stays_at_default(slot))]
        remote.driver.accept_generation(remote.rows)
        self._beginning = True
        for slot in remote.place:
            self.was_initialized_again(slot)
        self._beginning = False
        if lost or not remote.told_again:
            left_out = remote.limits["initialised"].admit(self.clock.now)
            remote.told_again = left_out is not None and remote.told_away
            if left_out is not None:
                self.events.add(partial(_renewed, self.clock.now, remote.path, lost, left_out), logged=True)

    # Age -----------------------------------------------------------------------------------------------

    def _judge_ages(self, remote: Remote, now: float) -> None:
        max_age = remote.driver.max_age
        times = self.columns.times[remote.watched]
        fresh = now - times <= max_age  # not, where it is NaN
        remote.until = float(times.min(initial=np.inf)) + max_age if fresh.all() else -np.inf
        failed = []
        for slot, age in zip(remote.watched[~fresh].tolist(), (now - times[~fresh]).tolist(), strict=True):
            if age <= BAD_AGES * max_age:
                self._set_stale(slot)
            else:
                failed.append(slot)
        if failed:
            self._too_old(remote, failed)
        if not fresh.all() and not remote.told_away and now - remote.last > max(LONG_ABSENCE, BAD_AGES * max_age):
            remote.told_away = True
            left_out = remote.limits["away"].admit(now)
            remote.tells_end = left_out is not None
            if left_out is not None:
                self.events.add(partial(_away, now, remote.path, remote.driver.cause(-1), left_out), logged=True)

    def _set_stale(self, slot: int) -> None:
        if self.quality[slot] == Quality.GOOD:  # what was not good is no better for being old
            self._set_quality(slot, Quality.STALE)

    def _too_old(self, remote: Remote, slots: Sequence[int]) -> None:
        """What marks its sensor BAD is said once."""
        items: Any = self.items
        bad = int(Quality.BAD)
        new = [slot for slot in slots if self.quality[slot] != bad or not getattr(items[slot], "_marks", False)]
        limit = f" (limit {duration(BAD_AGES * remote.driver.max_age)})"
        found = remote.driver.causes([remote.place[slot] for slot in new])
        words = {cause: f"{cause}{limit}" for cause in dict.fromkeys(found)}
        causes = dict(zip(new, map(words.__getitem__, found), strict=True))
        outputs = {slot: causes.pop(slot) for slot in new if items[slot].direction is Direction.OUTPUT}
        self._fail_inputs(causes, self._failures)
        for slot, cause in outputs.items():
            self._fail_output(slot, cause, self._failures)

    def _look_at_orders(self, remote: Remote, now: float) -> None:
        """Which writes of asynchronous actuators were carried out."""
        driver = remote.driver
        rows: Any = remote.rows
        for slot, (number, since) in tuple(remote.awaited.items()):
            place, late = remote.place[slot], now - since
            if driver.carried_out(number, place, rows):
                del remote.awaited[slot]
                self._date(remote, rows[Row.STAMP], now)
                if rows[Row.STAMP, place] == NEVER:
                    self.transfer.note(slot, Kind.CONFIRMED, ErrorKind.OTHER)
                    self._fail_output(slot, driver.cause(place), self._failures)
                else:
                    super()._accepted(slot)
                    self.times[slot] = time = float(remote.times[place])
                    self.transfer.note(slot, Kind.CONFIRMED, time=time)
            elif late > BAD_AGES * driver.max_age:
                self._too_old(remote, [slot])
                if self.quality[slot] == Quality.BAD:
                    del remote.awaited[slot]
            elif late > driver.max_age:
                self._set_stale(slot)

    # Some objects --------------------------------------------------------------------------------------

    def _read_at(self, slot: int) -> float:
        """A reading that has arrived has its own time."""
        remote = self._remote_of.get(slot)
        if remote is None or not remote.driver.running:
            return super()._read_at(slot)
        self._date(remote, remote.driver.read_rows[Row.STAMP], self.clock.now)
        return float(remote.times[remote.place[slot]])

    def _accept(self, slot: int, raw: int, failures: list[Failure]) -> None:
        """A reading that has arrived has its own time."""
        super()._accept(slot, raw, failures)
        remote = self._remote_of.get(slot)
        if remote is None or not remote.driver.running or self.times[slot] != self.clock.now:
            return
        place = remote.place[slot]
        self._date(remote, remote.driver.read_rows[Row.STAMP], self.clock.now)
        self.times[slot] = time = float(remote.times[place])
        self.transfer.note(slot, Kind.ARRIVED, time=time)
        age = self.clock.now - time
        if age > BAD_AGES * remote.driver.max_age:
            self._fail_input(slot, remote.driver.cause(place), failures)
        elif age > remote.driver.max_age:
            self._set_stale(slot)

    def _accepted(self, slot: int) -> None:
        """While the machine runs a write is accepted when the device has confirmed it."""
        remote = self._remote_of.get(slot)
        if remote is None or not remote.driver.running or self._beginning:
            super()._accepted(slot)
        elif not self.items[slot].synchronous:
            first = remote.awaited.get(slot, (0, self.clock.now))[1]
            remote.awaited[slot] = remote.driver.order(remote.place[slot]), first

    def try_send(self, slot: int) -> list[Failure]:
        """What was ordered already is not ordered again before it is carried out."""
        remote = self._remote_of.get(slot)
        if remote is not None and slot in remote.awaited and self.sent[slot] == self.pending[slot]:
            return []
        return super().try_send(slot)


def _away(now: float, path: str, cause: str, left_out: int) -> Event:
    """No value of a driver has come for long."""
    return limited(now, path, f"is away: {cause}", left_out)


def _renewed(now: float, path: str, lost: Sequence[str], left_out: int) -> Event:
    """A worker has initialised a driver again; `lost` are the actuators that stay at their defaults."""
    stay = "is at its default" if len(lost) == 1 else "are at their defaults"
    text = "was initialised again" + (f"; {some(lost)} {stay}" if lost else "")
    return limited(now, path, text, left_out)


def image_of(wired: Wired, clock: Clock, equipment: int, axes: int = 0, alarms: int = 0) -> Image:
    """The image of a machine: without drivers off the cycle the plain one, which knows nothing of them."""
    off = any(isinstance(driver, OffCycle) for driver in wired.drivers.values())
    return (OffCycleImage if off else Image)(wired, clock, equipment, axes, alarms)
