"""The connection of a machine with its drivers off the cycle (`umo.drivers.off_cycle`).

The values arrive independently of the period. Each has a stamp: the time at which its transfer began. The state of a
value depends only on its age. A value older than the driver's `max_age` is STALE. A value older than twice this time
has failed; `on_error` of its object decides the reaction. So one failed transfer of a slow device is not a failure, and
an old value never looks fresh, whatever happens to the worker process. Outputs are posted in each period; `read`
returns the value that the device has confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from umo.cycle.capability import Capability
from umo.cycle.columns import Block
from umo.cycle.deliveries import AtOnce, WithPeriod
from umo.cycle.events import Event, EventLimit, limited
from umo.cycle.image import Image
from umo.cycle.journal import ErrorKind, Kind
from umo.drivers.absence import LONG_ABSENCE
from umo.drivers.contract import Direction
from umo.drivers.off_cycle import NO_TIME, OffCycle
from umo.drivers.off_cycle.proxy import generation_of
from umo.drivers.off_cycle.shared_memory import Cell, Row
from umo.duration import duration
from umo.errors import Failure, cause_of_failure
from umo.objects import Quality
from umo.objects.scaling import FloatArray, IntArray
from umo.text import some
from umo.wiring.wired import Wired

if TYPE_CHECKING:
    from umo.cycle.machine import ConnectedMachine

BAD_AGES = 2
"""The age at which a value has failed, as a multiple of `max_age`."""


class WorkerLink:
    """One driver off the cycle, as the image uses it. The place of a channel is the index of the channel in the
    exchange."""

    def __init__(self, image: Image, name: str, driver: OffCycle) -> None:
        self.driver = driver
        self.path = f"driver {name}"
        """The path of its events."""
        slots = [slot for slot, wire in enumerate(image.wires) if wire.driver is driver]
        self.place = {slot: driver.exchange.place[image.wires[slot].channel.text] for slot in slots}
        """The place of each slot's channel."""
        mine = [block for block in image.blocks if block.driver is driver]
        reads = [image.items[block.start].direction is Direction.INPUT for block in mine]
        self.inputs = [block for block, each in zip(mine, reads, strict=True) if each]
        self.outputs = [block for block, each in zip(mine, reads, strict=True) if not each]
        self.watched = np.array([slot for slot in slots if image.items[slot].synchronous], np.int64)
        """The slots whose ages are watched: those that are transferred in each period of the driver."""
        self.arrived = -1
        """The count of transfers up to which the image has taken the values."""
        self.rows = driver.exchange.arrivals.read()[1]
        """The rows that were taken last."""
        self.until = -np.inf
        """Time in s up to which no value becomes too old."""
        self.stamps = np.full(len(driver.exchange.channels), NO_TIME)
        self.times: FloatArray = np.full(len(self.stamps), np.nan)
        """Time of each channel's value in s on the cycle's clock, by place."""
        self.awaited: dict[int, tuple[int, float]] = {}
        """The asynchronous actuators with an order that is not carried out yet, each with the number of the last order
        and the time in s of the first pending order."""
        self.told_away = False
        """True if the driver counts as away, or its outputs as not written, because no value has arrived for a long
        time."""
        self.tells_end = False
        """True if the absence had an event, so that its end must have one, too."""
        self.told_again = False
        """True if an initialisation has had an event since the absence began."""
        self.limits = {text: EventLimit() for text in ("away", "initialised")}
        self.last = np.zeros(len(self.stamps))
        """The time in s at which a value of each channel was taken last, by place."""
        written = [self.place[slot] for block in self.outputs for slot in range(block.start, block.stop)]
        self.written = np.array(written, np.int64)
        """The places of the outputs that each transfer writes."""

    def silence(self, now: float) -> str:
        """Return the text of the event if for a long time no value has arrived or no output was confirmed; otherwise
        ""."""
        since = now - max(LONG_ABSENCE, BAD_AGES * self.driver.max_age)
        if self.last.max() < since:
            return f"is away: {self.driver.cause(-1)}"
        if self.written.size and self.last[self.written].max() < since:
            return f"accepts no output: {self.driver.cause(int(self.written[0]))}"
        return ""


class OffCycleDrivers(Capability):
    """The drivers off the cycle of one machine. It is also the `Elsewhere` of their sensors."""

    def __init__(self, image: Image, wired: Wired, drivers: Sequence[tuple[str, OffCycle]]) -> None:
        self._image, self._clock, self._columns = image, image.clock, image.columns
        self._links = [WorkerLink(image, name, driver) for name, driver in drivers]
        self._remote_of = {slot: link for link in self._links for slot in link.place}
        posted, ordered = Posted(self, image), Ordered(self, image)
        for slot in self._remote_of:
            if image.items[slot].direction is Direction.INPUT:
                image.elsewhere[slot] = self
            else:
                image.deliveries[slot] = ordered if image.deliveries[slot].at_once else posted
        self._beginning = False
        """True while the objects that a worker has initialised are taken over."""
        self._updated = False
        """True if the present values of the outputs were not posted yet."""
        self._faults = wired.injection
        workers = any(link.driver.worker is not None for link in self._links)
        self._ns: Callable[[], int] = monotonic_ns if workers else self._machine_ns
        self._now_ns = self._ns()
        """The time in ns of the last sample, at `clock.now`."""
        for link in self._links:
            if link.driver.worker is None:
                link.driver.server.ns = self._machine_ns
            if self._faults is not None:
                link.driver.fault_time = self._fault_time

    def _machine_ns(self) -> int:
        return round(self._clock.now * 1e9)

    def _fault_time(self) -> int:
        assert self._faults is not None
        return NO_TIME if self._faults.clock is None else self._machine_ns()

    def attach(self, machine: ConnectedMachine) -> None:
        """Add the exchange with these drivers to the phase before the wait for the next tick. There the exchange delays
        no output."""
        period = machine.phases
        timer = self._image.timer >= 0
        (period.before_tick if timer else period.receiving).append(self._exchange)
        period.receiving.append(self._receive)
        period.before_send.append(self._note_sent)

    def begin(self) -> None:
        """Begin: from now on no call of these drivers waits."""
        for link in self._links:
            self._image.segments.on_call()
            link.driver.begin()
        self._now_ns = self._ns()
        self._exchange()

    def end(self) -> None:
        """End, because the machine stops. From now on each call is made and waits for its device."""
        for link in self._links:
            link.driver.end()

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Let no call reach a device any more."""
        for link in self._links:
            link.driver.refuse(instead)

    # A whole period ------------------------------------------------------------------------------------

    def _receive(self) -> None:
        """Check whether arrived values have become too old, and whether orders were carried out."""
        now = self._clock.now
        self._now_ns = self._ns()
        for link in self._links:
            if now > link.until:
                self._judge_ages(link, now)
            if link.awaited:
                self._look_at_orders(link, now)
        if self._image.found:
            self._image.sampled_good = None

    def _note_sent(self) -> None:
        """Record that the values of the outputs are to be posted before the next tick."""
        self._updated = True

    def _exchange(self) -> None:
        """Post the values of the outputs, and take over the values that have arrived."""
        now, updated, self._updated = self._clock.now, self._updated, False
        for link in self._links:
            driver = link.driver
            if not driver.running:
                continue
            if updated:
                for block in link.outputs:
                    self._post(link, block, now)
            if self._faults is not None:
                driver.exchange.cells[Cell.NOW] = self._fault_time()
            if driver.worker is None:
                driver.server.work()
            if driver.exchange.arrivals.count != link.arrived:
                self._take(link, now)

    def _post(self, link: WorkerLink, block: Block, now: float) -> None:
        """Post the values of a block. Slew rates apply from the time of the last confirmed value."""
        confirmed = float(self._columns.times[block.slots].max())
        try:
            block.give(now, min(now - confirmed, link.driver.max_age))
        except Exception:  # of a linearization of the user's
            self._image.give_each(range(block.start, block.stop), self._image.found)
        link.driver.write_many(block.channels, block.buffer)

    # What arrives --------------------------------------------------------------------------------------

    def _take(self, link: WorkerLink, now: float) -> None:
        """Take over the values of a complete transfer of the worker, with their times."""
        driver = link.driver
        link.arrived, link.rows = driver.exchange.arrivals.read()
        rows = driver.read_rows = link.rows
        if generation_of(rows) != driver.generation:
            self._begin_generation(link)
        arrived = self._date(link, rows[Row.STAMP], now)
        for block in link.inputs:
            self._convert_arrivals(link, block, rows, now)
        for block in link.outputs:
            self._confirm(link, block, rows)
        link.until = -np.inf
        away = driver.exchange.cells[Cell.AWAY_SINCE] != NO_TIME
        if link.told_away and arrived and not away and not link.silence(now):
            link.told_away = link.told_again = False
            if link.tells_end:
                self._image.events.add(Event(now, link.path, "is back"), logged=True)

    def _date(self, link: WorkerLink, stamps: IntArray, now: float) -> bool:
        """Set the times of the arrived values. Return True if a new value has arrived."""
        new = np.flatnonzero(stamps != link.stamps)
        if not new.size:
            return False
        link.times[new] = link.driver.times(new, stamps[new], now, self._now_ns)
        link.stamps = stamps.copy()
        arrived = new[stamps[new] != NO_TIME]
        link.last[arrived] = now
        return bool(arrived.size)

    def _convert_arrivals(self, link: WorkerLink, block: Block, rows: IntArray, now: float) -> None:
        places = link.driver.places(block.channels)
        block.buffer[:] = raws = rows[Row.RAW, places]
        before = self._columns.raws[block.slots].copy()
        if block.conditioned is not None:
            block.conditioned.stamps = link.times[places]
        try:
            outside = block.convert(now)
        except Exception:  # of a linearization of the user's
            self._image.accept_each(block, {}, self._image.found)
        else:
            if outside or block.unsettled:
                self._image.settle_block(block, outside, now, self._image.found)
        times = self._columns.times[block.slots]
        stamped = link.times[places]
        times[:] = np.where(times == now, stamped, times)  # what failed keeps the time of its last value
        never = np.isnan(stamped)
        if never.any():
            self._columns.values[block.slots][never] = np.nan
            times[never] = np.nan
        self._note(Kind.ARRIVED, block, raws, before, stamped)

    def _note(self, kind: Kind, block: Block, raws: IntArray, before: IntArray, times: FloatArray) -> None:
        """Record arrived values with their times in the journal. A replay of a recording uses these entries."""
        journal = self._image.transfer.journal
        if journal is not None:
            journal.add_rows(range(block.start, block.stop), kind, raws, before, times=times)

    def _confirm(self, link: WorkerLink, block: Block, rows: IntArray) -> None:
        """Set the values that the device has accepted. The value sent last is set as it was written; an older value is
        computed from its raw integer."""
        columns, slots = self._columns, block.slots
        places = link.driver.places(block.channels)
        raws, times = rows[Row.RAW, places], link.times[places]
        same = raws == columns.sent_raws[slots]
        columns.values[slots] = np.where(same, columns.sent[slots], columns.values[slots])
        for number in np.flatnonzero(~same & (raws != columns.raws[slots])).tolist():
            slot = block.start + number
            try:
                self._image.values[slot] = self._image.value_of(slot, int(raws[number]))
            except Exception as error:  # of a linearization of the user's
                self._image.fail_output(slot, f"its linearization failed: {cause_of_failure(error)}", self._image.found)
        self._note(Kind.CONFIRMED, block, raws, columns.raws[slots], times)
        columns.raws[slots] = raws
        newer = times > columns.times[slots]
        columns.times[slots] = np.where(newer, times, columns.times[slots])
        for slot in tuple(block.unsettled):
            if newer[slot - block.start]:
                block.unsettled.discard(slot)
                self._image.set_quality(slot, Quality.GOOD)

    def _begin_generation(self, link: WorkerLink) -> None:
        """Handle a repeated initialisation of the objects, by the worker or by a worker that has taken its place."""
        self._image.transfer.note(next(iter(link.place)), Kind.RENEWED)
        link.awaited.clear()
        lost = [path for slot in link.place if (path := self._image.path_if_default_kept(slot))]
        link.driver.accept_generation(link.rows)
        self._beginning = True
        for slot in link.place:
            self._image.was_initialized_again(slot)
        self._beginning = False
        if lost or not link.told_again:
            left_out = link.limits["initialised"].admit(self._clock.now)
            link.told_again = left_out is not None and link.told_away
            if left_out is not None:
                self._image.events.add(partial(_renewed, self._clock.now, link.path, lost, left_out), logged=True)

    # Age -----------------------------------------------------------------------------------------------

    def _judge_ages(self, link: WorkerLink, now: float) -> None:
        max_age = link.driver.max_age
        times = self._columns.times[link.watched]
        fresh = now - times <= max_age  # not, where it is NaN
        link.until = float(times.min(initial=np.inf)) + max_age if fresh.all() else -np.inf
        failed = []
        for slot, age in zip(link.watched[~fresh].tolist(), (now - times[~fresh]).tolist(), strict=True):
            if age <= BAD_AGES * max_age:
                self._set_stale(slot)
            else:
                failed.append(slot)
        if failed:
            self._too_old(link, failed)
        if not fresh.all() and not link.told_away and (silence := link.silence(now)):
            link.told_away = True
            left_out = link.limits["away"].admit(now)
            link.tells_end = left_out is not None
            if left_out is not None:
                self._image.events.add(partial(limited, now, link.path, silence, left_out), logged=True)

    def _set_stale(self, slot: int) -> None:
        if self._image.quality[slot] == Quality.GOOD:  # what was not good is no better for being old
            self._image.set_quality(slot, Quality.STALE)

    def _too_old(self, link: WorkerLink, slots: Sequence[int]) -> None:
        """Report once that values are too old. Their sensors are marked BAD."""
        items: Any = self._image.items
        bad = int(Quality.BAD)
        new = [slot for slot in slots if self._image.quality[slot] != bad or not getattr(items[slot], "_marks", False)]
        limit = f" (limit {duration(BAD_AGES * link.driver.max_age)})"
        found = link.driver.causes([link.place[slot] for slot in new])
        words = {cause: f"{cause}{limit}" for cause in dict.fromkeys(found)}
        causes = dict(zip(new, map(words.__getitem__, found), strict=True))
        outputs = {slot: causes.pop(slot) for slot in new if items[slot].direction is Direction.OUTPUT}
        self._image.fail_inputs(causes, self._image.found)
        for slot, cause in outputs.items():
            self._image.fail_output(slot, cause, self._image.found)

    def _look_at_orders(self, link: WorkerLink, now: float) -> None:
        """Check which writes of asynchronous actuators were carried out."""
        driver = link.driver
        rows: Any = link.rows
        for slot, (number, since) in tuple(link.awaited.items()):
            place, late = link.place[slot], now - since
            if driver.carried_out(number, place, rows):
                del link.awaited[slot]
                self._date(link, rows[Row.STAMP], now)
                if rows[Row.STAMP, place] == NO_TIME:
                    self._image.transfer.note(slot, Kind.CONFIRMED, ErrorKind.OTHER)
                    self._image.fail_output(slot, driver.cause(place), self._image.found)
                else:
                    self._image.confirmed(slot)
                    self._image.times[slot] = time = float(link.times[place])
                    self._image.transfer.note(slot, Kind.CONFIRMED, time=time)
            elif late > BAD_AGES * driver.max_age:
                self._too_old(link, [slot])
                if self._image.quality[slot] == Quality.BAD:
                    del link.awaited[slot]
            elif late > driver.max_age:
                self._set_stale(slot)

    # Some objects --------------------------------------------------------------------------------------

    def read_at(self, slot: int) -> float:
        link = self._remote_of[slot]
        if not link.driver.running:
            return self._clock.read()
        self._date(link, link.driver.read_rows[Row.STAMP], self._clock.now)
        return float(link.times[link.place[slot]])

    def was_read(self, slot: int, failures: list[Failure]) -> None:
        link = self._remote_of[slot]
        if not link.driver.running:
            return
        place, image, now = link.place[slot], self._image, self._clock.now
        self._date(link, link.driver.read_rows[Row.STAMP], now)
        image.times[slot] = time = float(link.times[place])
        image.transfer.note(slot, Kind.ARRIVED, time=time)
        if now - time > BAD_AGES * link.driver.max_age:
            image.fail_input(slot, link.driver.cause(place), failures)
        elif now - time > link.driver.max_age:
            self._set_stale(slot)

    def confirms_later(self, slot: int) -> bool:
        """Return True while the machine runs. A write is then accepted only when the device has confirmed it."""
        return self._remote_of[slot].driver.running and not self._beginning

    def order(self, slot: int) -> None:
        """Order the sent value of an asynchronous actuator."""
        link = self._remote_of[slot]
        first = link.awaited.get(slot, (0, self._clock.now))[1]
        link.awaited[slot] = link.driver.order(link.place[slot]), first

    def is_ordered(self, slot: int) -> bool:
        """Return True if a write was already ordered. A write is not ordered again before it is carried out."""
        return slot in self._remote_of[slot].awaited and self._image.sent[slot] == self._image.pending[slot]


class Posted(WithPeriod):
    """Delivery of an actuator whose value is posted by the period and confirmed later by the device."""

    def __init__(self, drivers: OffCycleDrivers, image: Image) -> None:
        super().__init__(image)
        self._drivers = drivers

    def accepted(self, slot: int) -> None:
        if not self._drivers.confirms_later(slot):
            super().accepted(slot)

    def goes_on(self, slot: int) -> None:
        """Record that the device has been initialised again and gets the pending value. An actuator with "retry" is
        STALE until the device has confirmed the value."""
        if self._items[slot]._max_age is not None and not self._image.is_at_default(slot):
            self._image.set_quality(slot, Quality.STALE)


class Ordered(AtOnce):
    """Delivery of an actuator whose value is ordered by a write and confirmed later by the device."""

    def __init__(self, drivers: OffCycleDrivers, image: Image) -> None:
        super().__init__(image)
        self._drivers = drivers

    def written(self, slot: int) -> list[Failure]:
        return [] if self._drivers.is_ordered(slot) else super().written(slot)

    def accepted(self, slot: int) -> None:
        if self._drivers.confirms_later(slot):
            self._drivers.order(slot)
        else:
            super().accepted(slot)


def off_cycle_drivers(image: Image, wired: Wired) -> list[OffCycleDrivers]:
    """Return a list with one capability for all drivers off the cycle of a machine, or an empty list if there are no
    such drivers."""
    drivers = [(name, driver) for name, driver in wired.drivers.items() if isinstance(driver, OffCycle)]
    return [OffCycleDrivers(image, wired, drivers)] if drivers else []


def _renewed(now: float, path: str, lost: Sequence[str], left_out: int) -> Event:
    """Return the event that a worker has initialised a driver again. `lost`: the paths of the actuators that stay at
    their defaults."""
    stay = "is at its default" if len(lost) == 1 else "are at their defaults"
    text = "was initialised again" + (f"; {some(lost)} {stay}" if lost else "")
    return limited(now, path, text, left_out)
