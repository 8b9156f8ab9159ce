"""The transfer stage: every call of a driver is made here, for the image and for the guardian.

This stage contains everything that a call needs: the journal, the mapping of exceptions to the objects concerned, and
the list of drivers that do not answer. `callees.py` contains the receivers of calls, `segments.py` the calls outside of
a period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import nan
from operator import index
from time import monotonic
from typing import Any, NoReturn

import numpy as np

from umo.cycle.callees import Callees, refuse_write
from umo.cycle.columns import Block
from umo.cycle.journal import OF_BLOCK, ErrorKind, Journal, Kind
from umo.cycle.stand_ins import NotCalled
from umo.drivers.contract import UNREAD, Channel, Driver, not_whole
from umo.errors import FAILURES, ChannelsFailed, Failure, cause_of_failure
from umo.objects.scaling import IntArray
from umo.text import in_brackets, some
from umo.wiring.wired import Wire, Wired


class _Refused(Sequence[Wire]):
    """Replaces the wires when no device may be used: access to a wire calls `instead`, which does not return."""

    def __init__(self, instead: Callable[..., NoReturn]) -> None:
        self._instead = instead

    def __getitem__(self, slot: Any) -> NoReturn:
        self._instead()

    def __len__(self) -> NoReturn:
        self._instead()


class Transfer:
    """The drivers of one machine. A slot is an index into `wires` and `raws`."""

    def __init__(self, wires: Sequence[Wire], wired: Wired, timer: int = -1, raws: IntArray | None = None) -> None:
        self.wires = wires
        self.timer = timer
        self.callees = Callees(wires)
        """The receivers of calls."""
        self._callees: Any = self.callees.of  # a look-up less in each call
        self._real = {id(wired.drivers[name]) for name in wired.hardware}
        self._names = {
            id(driver): f"{name}{in_brackets(some(wired.hardware.get(name, ())))}"
            for name, driver in wired.drivers.items()
        }
        if (timer_wire := wired.timer_wire) is not None:  # a paced timer stands in the place of its driver
            driver = timer_wire.driver
            self._names.setdefault(id(driver), self._names.get(id(getattr(driver, "timer", None)), "timer"))
        self._known = [(wire.path, wire.channel.text, self._names.get(id(wire.driver), "")) for wire in wires]
        """The path of each object, the text of its channel and the name of its driver."""
        self._memory = np.zeros(len(wires), np.int64) if raws is None else raws
        self.raws: Any = self._memory.data  # a memoryview: quicker than numpy's items
        """The raw value that each object last had at the hardware."""
        self.journal: Journal | None = None
        """The journal of transfers of single objects; None if it is not used."""
        self.now: Callable[[], float] = monotonic
        """The clock in s that determines whether a call has taken too long."""
        self.tick: Callable[[Channel], int]
        """The function that reads the timer."""
        self.has_ticked: Callable[[int], object] | None = None
        """The function that is called with the duration in ns of a reading that was not made by `tick`."""
        self.defaults = [wire.default for wire in wires]
        """The raw integer of each actuator's default; None for a sensor. It is computed once, because a reset must not
        depend on a user-defined linearization."""
        self.late: dict[int, float] = {}
        """Drivers (by id) that timed out, with the time of the timeout."""
        self.unsure = False
        """True if a write to hardware has failed, but the device may still carry it out."""

    # Blocks: a whole period ----------------------------------------------------------------------------

    def bind(self, inputs: Iterable[Block], outputs: Iterable[Block]) -> None:
        """Set the blocks' `transfer` and the timer's `tick` to the functions of the drivers."""
        self.callees.bind(inputs, outputs)
        if self.timer >= 0:
            self.tick, self.has_ticked = self.wires[self.timer].driver.read, None

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Replace every call of a driver by `instead`, which does not return."""
        self.tick, self.has_ticked = instead, None
        self.wires = self._callees = self.callees.of = _Refused(instead)
        self.callees.refuse(instead)

    def block_failed(self, block: Block, error: BaseException, inputs: bool) -> list[tuple[int, str]]:
        """Return the failed slots of a block, each with its cause; the others have succeeded."""
        written = None if inputs else block.view
        return self._failed(block.driver, range(block.start, block.stop), error, written, OF_BLOCK)

    # Some objects --------------------------------------------------------------------------------------

    def read(self, slot: int) -> int:
        """Return one object's raw integer, read from the hardware now. Any exception of its driver is raised."""
        wire = self.wires[slot]
        if slot == self.timer:
            self.raws[slot] = raw = index(self.tick(wire.channel))
            return raw
        try:
            reading = self._callees[slot].read(wire.channel)
            try:
                raw = index(reading)
            except TypeError:
                raise not_whole(wire.driver, wire.channel, reading) from None
        except FAILURES as error:
            self.mark(wire.driver, error, False)
            self.note(slot, Kind.FAILED_READ, ErrorKind.of(error))
            raise
        self.moved(slot, raw, Kind.READ)
        return raw

    def write(self, slot: int, raw: int) -> None:
        """Write one object's raw integer to the hardware now. Any exception of its driver is raised."""
        wire = self.wires[slot]
        try:
            if not self.callees.written:
                refuse_write()
            self._callees[slot].write(wire.channel, raw)
        except FAILURES as error:
            self.mark(wire.driver, error, True)
            self.note(slot, Kind.FAILED_WRITE, ErrorKind.of(error), raw)
            raise
        self.moved(slot, raw, Kind.WRITE)

    def read_some(self, slots: Sequence[int]) -> Iterator[tuple[int, int | str]]:
        """Read some sensors, with one transfer per driver. Return each slot with its raw integer, or with the cause of
        its failure."""
        for driver, group in self.by_driver(slots):
            out = np.full(len(group), UNREAD)
            failed = self._some(self._callees[group[0]].read_many, driver, group, out, False)
            for slot, raw in zip(group, out.tolist(), strict=True):
                if slot in failed:
                    yield slot, failed[slot]
                else:
                    self.moved(slot, raw, Kind.READ)
                    yield slot, raw

    def write_some(self, slots: Sequence[int], raws: IntArray) -> Iterator[tuple[int, str | None]]:
        """Write some actuators, with one transfer per driver, from the raw integers of the whole machine. Return each
        slot with the cause of its failure, or None."""
        for driver, group in self.by_driver(slots):
            failed = self._some(self._callees[group[0]].write_many, driver, group, raws[group], True)
            for slot in group:
                if slot not in failed:
                    self.moved(slot, int(raws[slot]), Kind.WRITE)
                yield slot, failed.get(slot)

    def _some(self, call: Any, driver: Driver[Any], group: list[int], raws: IntArray, write: bool) -> dict[int, str]:
        try:
            if write and not self.callees.written:
                refuse_write()
            call(tuple(self.wires[slot].channel for slot in group), raws)
        except FAILURES as error:
            return dict(self._failed(driver, group, error, raws.tolist() if write else None))
        self.late.pop(id(driver), None)
        return {}

    # What every call has in common ---------------------------------------------------------------------

    def mark(
        self, driver: Driver[Any], error: BaseException, write: bool, took: float = 0.0, whole: bool = False
    ) -> None:
        """Record a failed call, for the `whole` driver or for one object."""
        if isinstance(error, NotCalled):
            return
        timed_out = isinstance(error, TimeoutError) or took >= driver.timeout
        if timed_out:
            self.late[id(driver)] = self.now()
        if write and id(driver) in self._real:
            self.unsure = True
        if timed_out or whole:
            self.callees.away.failed(driver, error, timed_out, write)

    def _failed(
        self,
        driver: Driver[Any],
        slots: Sequence[int],
        error: BaseException,
        written: Sequence[int] | None,
        time: float = nan,
    ) -> list[tuple[int, str]]:
        """Return the failed slots of a block, each with its cause: all slots, or those that the driver names.
        `written`: the raw integers that were to be written, or None if the block was read. `time` is for the
        journal."""
        self.mark(driver, error, written is not None, whole=not isinstance(error, ChannelsFailed))
        causes, whole = error.causes if isinstance(error, ChannelsFailed) else {}, cause_of_failure(error)
        known = self._known if causes else ()
        named = [(slot, causes[text]) for slot in slots if (text := known[slot][1]) in causes] if known else []
        failed = named or [(slot, whole) for slot in slots]
        if self.journal is not None:
            numbers = [slot for slot, _ in failed]
            kind = ErrorKind.CHANNELS if named else ErrorKind.of(error)
            if written is None:
                self.note_each(numbers, Kind.FAILED_READ, kind, None, time)
            else:
                meant = dict(zip(slots, written, strict=True))
                self.note_each(numbers, Kind.FAILED_WRITE, kind, [meant[slot] for slot in numbers], time)
        return failed

    def words_of(self, driver: Driver[Any]) -> str:
        """Return the driver and its device as text."""
        return self._names[id(driver)]

    def failure(self, slot: int, cause: str) -> Failure:
        """Return the failure of one object."""
        path, channel, driver = self._known[slot]
        return Failure(path, channel, cause, driver)

    def moved(self, slot: int, raw: int, kind: Kind) -> None:
        """Record that an object has this raw integer at the hardware."""
        if self.journal is not None:
            self.journal.add(slot, kind, raw, self.raws[slot])
        self.raws[slot] = raw

    def note(
        self, slot: int, kind: Kind, error: ErrorKind = ErrorKind.NONE, raw: int | None = None, time: float = nan
    ) -> None:
        """Add an event of this object, whose level did not change, to the journal, if there is one. `raw` is the value
        to be written. `time` is the time of a value from a worker process, or `OF_BLOCK`."""
        if self.journal is not None and slot != self.timer:
            before = self.raws[slot]
            self.journal.add(slot, kind, before if raw is None else raw, before, error, time)

    def note_each(
        self,
        slots: Sequence[int],
        kind: Kind,
        error: ErrorKind = ErrorKind.NONE,
        raws: Sequence[int] | None = None,
        time: float = nan,
    ) -> None:
        """Add events of many objects to the journal, in this order. The timer must not be among them."""
        if self.journal is not None:
            self.journal.add_each(slots, kind, self._memory, error, raws, time)

    def note_look(self, driver: Driver[Any], found: bool | None) -> None:
        """Add to the journal the result of a look for a driver that is away."""
        slot = next(slot for slot in self.callees.slots[id(driver)] if slot != self.timer)
        self.note(slot, Kind.LOOKED, raw=-1 if found is None else int(found))

    def by_driver(self, slots: Iterable[int]) -> list[tuple[Driver[Any], list[int]]]:
        groups: dict[int, tuple[Driver[Any], list[int]]] = {}
        for slot in slots:
            driver = self.wires[slot].driver
            groups.setdefault(id(driver), (driver, []))[1].append(slot)
        return list(groups.values())
