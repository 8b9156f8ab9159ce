"""The transfer stage: every call of a driver is made here, for the image and for the guardian.

What every call needs is here once: the journal, mapping exceptions to the objects concerned, and the list of drivers
that do not answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import inf, nan
from operator import index
from time import monotonic, sleep
from typing import Any, Literal, NoReturn, TypeVar

import numpy as np

from umo.cycle.columns import Block
from umo.cycle.journal import OF_BLOCK, ErrorKind, Journal, Kind
from umo.cycle.stand_ins import NobodyAway, NotCalled
from umo.drivers.contract import UNREAD, Channel, Driver
from umo.drivers.off_cycle import OffCycle
from umo.drivers.optional import arm_watchdog, report_of
from umo.errors import ChannelsFailed, DriverError, Failure, forget_frames, text_of
from umo.objects.scaling import IntArray
from umo.text import in_brackets, some
from umo.wiring.wired import Wire, Wired

SETTLE = 0.25
"""Minimum time in s for a device to carry out requests that are still pending."""
MAX_SETTLE = 1.0
"""Maximum of the same for a device with a long timeout."""
FAILURES = (Exception, SystemExit)
"""Errors of a driver's call: a SystemExit would end the program as if all were well."""
UNCONTROLLED_TIMEOUT = 3.0
"""Timeout in s of a driver's call while nothing is controlled: when connecting, and for the guardian's resets. A device
that serves one connection at a time may need long to let go of the one before."""
WAIT_SLICE = 0.05
"""Time in s between two signs of life while waiting."""
LATE_TIME = 0.5
"""Time in s, plus twice its timeout, for which a driver that timed out is served last."""
T = TypeVar("T")
BlockTransfer = Callable[[Any, IntArray], None]
_JOURNAL_KINDS = {"initialize": Kind.INITIALIZE, "reset": Kind.RESET}


def _refuse_write(*_: object) -> NoReturn:
    raise DriverError("the machine has been reset; nothing is written any more")


class _Refused(Sequence[Wire]):
    """Wires that lead nowhere: whoever asks for one calls `instead`, which does not return."""

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
        self._callees: Any = [wire.driver for wire in wires]
        """Where the calls of each object's driver go: to the driver, or to a stand-in while it is away."""
        self.drivers = wired.drivers
        self.timer = timer
        self._real = {id(wired.drivers[name]) for name in wired.hardware}
        self._names = {
            id(driver): f"{name}{in_brackets(some(wired.hardware.get(name, ())))}"
            for name, driver in wired.drivers.items()
        }
        if (timer_wire := wired.timer_wire) is not None:  # a paced timer stands in the place of its driver
            driver = timer_wire.driver
            self._names.setdefault(id(driver), self._names.get(id(getattr(driver, "timer", None)), "timer"))
        self._known = [(wire.path, wire.channel.text, self._names.get(id(wire.driver), "")) for wire in wires]
        """Path, text of the channel and name of the driver of each object."""
        self._slots_of: dict[int, list[int]] = {}
        """The objects of each driver, by its id."""
        for slot, wire in enumerate(wires):
            self._slots_of.setdefault(id(wire.driver), []).append(slot)
        self._memory = np.zeros(len(wires), np.int64) if raws is None else raws
        self.raws: Any = self._memory.data  # a memoryview: quicker than numpy's items
        """The raw value that each object last had at the hardware."""
        self.journal: Journal | None = None
        """The journal of transfers of single objects; None if it is not used."""
        self.on_call: Callable[[], object] = lambda: None
        """Function that is called before each call that is not part of a period: a sign of life."""
        self.now: Callable[[], float] = monotonic
        """The clock in s by which a call has taken too long."""
        self.tick: Callable[[Channel], int]
        """The read of the timer."""
        self.defaults = [wire.default for wire in wires]
        """The raw integer of each actuator's default, None for a sensor: worked out once, as a reset must not depend on
        a linearization of the user's."""
        self._blocks: list[Block] = []
        self._outputs: list[Block] = []
        self._written = True
        """Whether writes are carried out."""
        self._late: dict[int, float] = {}
        """Drivers (by id) that timed out, with the time of the timeout."""
        self.unsure = False
        """Whether a write to hardware failed, which the device may still carry out."""
        self.away = NobodyAway()
        self.watched: Callable[[Block, BlockTransfer], BlockTransfer] = lambda block, call: call
        """Function that puts a watch around a block's transfer."""

        for driver in self.drivers.values():
            if isinstance(driver, OffCycle):
                driver.pause = self._wait_for_worker

    def _wait_for_worker(self, seconds: float) -> None:
        self.on_call()
        sleep(seconds)

    # Whole drivers -------------------------------------------------------------------------------------

    def open(self, name: str) -> None:
        self._whole(name, "opened", self.drivers[name].open)

    def close(self, name: str) -> None:
        self._whole(name, "closed", self.drivers[name].close)

    def watchdog(self, name: str, seconds: float) -> None:
        self._whole(name, "armed with its watchdog", lambda: arm_watchdog(self.drivers[name], seconds))

    def report(self, name: str) -> dict[str, Any]:
        return self._whole(name, "asked for its report", lambda: report_of(self.drivers[name]))

    def _whole(self, name: str, what: str, call: Callable[[], T]) -> T:
        self.on_call()
        try:
            return call()
        except DriverError as error:
            raise DriverError(f"driver {self._name(name)}: {error}", error.failures) from error
        except FAILURES as error:
            raise DriverError(f"driver {self._name(name)} could not be {what}: {text_of(error)}") from error

    def _name(self, name: str) -> str:
        return self._names[id(self.drivers[name])]

    def failed_whole(self, name: str, what: str, error: BaseException) -> Failure:
        """A call for a whole driver has failed."""
        cause = error.__cause__ or error  # the driver is named already
        return Failure(f"driver {name}", "-", f"{what}: {text_of(cause)}", self._name(name))

    # Blocks: a whole period ----------------------------------------------------------------------------

    def bind(self, inputs: Iterable[Block], outputs: Iterable[Block]) -> None:
        """The blocks' `transfer` and the timer's `tick` are the drivers' own."""
        inputs, outputs = list(inputs), list(outputs)
        self._blocks, self._outputs = inputs + outputs, outputs
        for block in self._blocks:
            self._bind(block)
        if self.timer >= 0:
            self.tick = self.wires[self.timer].driver.read

    def _bind(self, block: Block) -> None:
        callee = self._callees[block.start]
        if block not in self._outputs:
            block.transfer = self.watched(block, callee.read_many)
        else:
            block.transfer = self.watched(block, callee.write_many if self._written else _refuse_write)

    def exchange(self, driver: Driver[Any], callee: Any) -> None:
        """Let calls of this driver go to `callee` from now on."""
        for slot in self._slots_of.get(id(driver), ()):
            self._callees[slot] = callee
        for block in self._blocks:
            if block.driver is driver:
                self._bind(block)

    def end_absences(self) -> None:
        """Every call is made again, and waits: the machine stops."""
        self.away.end()
        self.away = NobodyAway()

    def name_if_away(self, driver: Driver[Any]) -> str:
        """The driver with its device, if it is away; else ""."""
        return self._names[id(driver)] if self.away.is_away(driver) else ""

    def is_unknown(self, slot: int) -> bool:
        """Whether the calls of its driver are refused, and it is not known yet whether the device answers."""
        return self.away.is_unknown(self.wires[slot].driver)

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Let no call reach a driver any longer: in its place `instead` is called, which does not return."""
        self.on_call = self.tick = instead
        self.wires = self._callees = _Refused(instead)
        self._slots_of = {}
        self.away.refuse(instead)
        for block in self._blocks:
            block.transfer = instead

    def end_writing(self) -> None:
        """Let no write reach a driver any longer, but resets: the actuators are at their defaults and stay there."""
        self._written = False
        for block in self._outputs:
            block.transfer = _refuse_write

    def block_failed(self, block: Block, error: BaseException, inputs: bool) -> list[tuple[int, str]]:
        """The slots of a block that failed, each with its cause; the others stand."""
        written = None if inputs else block.view
        return self._failed(block.driver, range(block.start, block.stop), error, written, OF_BLOCK)

    # Some objects --------------------------------------------------------------------------------------

    def read(self, slot: int) -> int:
        """One object's raw integer from the hardware, now; any exception of its driver."""
        wire = self.wires[slot]
        if slot == self.timer:
            self.raws[slot] = raw = index(self.tick(wire.channel))
            return raw
        try:
            raw = index(self._callees[slot].read(wire.channel))
        except FAILURES as error:
            self._mark(wire.driver, error, False)
            self.note(slot, Kind.FAILED_READ, ErrorKind.of(error))
            raise
        self._moved(slot, raw, Kind.READ)
        return raw

    def write(self, slot: int, raw: int) -> None:
        """One object's raw integer to the hardware, now; any exception of its driver."""
        wire = self.wires[slot]
        try:
            if not self._written:
                _refuse_write()
            self._callees[slot].write(wire.channel, raw)
        except FAILURES as error:
            self._mark(wire.driver, error, True)
            self.note(slot, Kind.FAILED_WRITE, ErrorKind.of(error), raw)
            raise
        self._moved(slot, raw, Kind.WRITE)

    def read_some(self, slots: Sequence[int]) -> Iterator[tuple[int, int | str]]:
        """Some sensors, one transfer a driver: each slot with its raw integer, or with the cause why there is none."""
        for driver, group in self.by_driver(slots):
            out = np.full(len(group), UNREAD)
            failed = self._some(self._callees[group[0]].read_many, driver, group, out, False)
            for slot, raw in zip(group, out.tolist(), strict=True):
                if slot in failed:
                    yield slot, failed[slot]
                else:
                    self._moved(slot, raw, Kind.READ)
                    yield slot, raw

    def write_some(self, slots: Sequence[int], raws: IntArray) -> Iterator[tuple[int, str | None]]:
        """Some actuators, one transfer a driver, from the raw integers of the whole machine: each slot with the cause
        of its failure, or None."""
        for driver, group in self.by_driver(slots):
            failed = self._some(self._callees[group[0]].write_many, driver, group, raws[group], True)
            for slot in group:
                if slot not in failed:
                    self._moved(slot, int(raws[slot]), Kind.WRITE)
                yield slot, failed.get(slot)

    def _some(self, call: Any, driver: Driver[Any], group: list[int], raws: IntArray, write: bool) -> dict[int, str]:
        try:
            if write and not self._written:
                _refuse_write()
            call(tuple(self.wires[slot].channel for slot in group), raws)
        except FAILURES as error:
            return dict(self._failed(driver, group, error, raws.tolist() if write else None))
        self._late.pop(id(driver), None)
        return {}

    # Connecting, resetting, leaving --------------------------------------------------------------------

    def initialize(self, slot: int) -> Failure | None:
        return self._segment(slot, "initialize", self.defaults[slot])

    def finalize(self, slot: int) -> Failure | None:
        return self._segment(slot, "finalize")

    def bring_to_default(
        self,
        slots: Iterable[int],
        segment: Literal["initialize", "reset"] = "reset",
        begin: Callable[[int], object] = lambda slot: None,
        patient: bool = True,
    ) -> Iterator[tuple[int, Failure | None]]:
        """Reset (or initialise) each in turn; one failure never stops the rest. The slots of a driver that does not
        answer in time are left to the end, so that it holds none of the others back; if not `patient`, they are left
        out: whoever comes again opens one connection more, not one for each. `begin` is called with each slot."""
        if not patient:
            self._late.clear()
        waiting: list[int] = []
        for slot in slots:
            if self._is_late(self.wires[slot].driver):
                waiting.append(slot)
            else:
                begin(slot)
                yield slot, self._segment(slot, segment, self.defaults[slot])
        for slot in waiting if patient else ():
            begin(slot)
            yield slot, self._segment(slot, segment, self.defaults[slot])

    def _segment(self, slot: int, segment: str, *default: int | None) -> Failure | None:
        """One of the paper's segments; what failed."""
        self.on_call()
        wire = self.wires[slot]
        began = self.now()
        try:
            getattr(self._callees[slot], segment)(wire.channel, *default)
        except BaseException as error:  # whatever a driver raises, the others are still to be brought to their defaults
            took = self.now() - began
            self._mark(wire.driver, error, True, took)
            kind = ErrorKind.TIMEOUT if took >= wire.driver.timeout else ErrorKind.of(error)
            self.note(slot, Kind.FAILED_RESET, kind, default[0] if default else None)
            return self.failure(slot, cause_of_failure(error))
        self._late.pop(id(wire.driver), None)
        if segment in _JOURNAL_KINDS:
            self._moved(slot, self.raws[slot] if default[0] is None else default[0], _JOURNAL_KINDS[segment])
        return None

    # What every call has in common ---------------------------------------------------------------------

    def _mark(
        self, driver: Driver[Any], error: BaseException, write: bool, took: float = 0.0, whole: bool = False
    ) -> None:
        """A call has failed, one of the `whole` driver or one for an object."""
        if isinstance(error, NotCalled):
            return
        timed_out = isinstance(error, TimeoutError) or took >= driver.timeout
        if timed_out:
            self._late[id(driver)] = self.now()
        if write and id(driver) in self._real:
            self.unsure = True
        if timed_out or whole:
            self.away.failed(driver, error, timed_out, write)

    def _failed(
        self,
        driver: Driver[Any],
        slots: Sequence[int],
        error: BaseException,
        written: Sequence[int] | None,
        time: float = nan,
    ) -> list[tuple[int, str]]:
        """The slots of a block that failed, with the cause: all of them, or those that the driver names. `written` are
        the raw integers that were to be written; None: it was read. `time` is for the journal."""
        self._mark(driver, error, written is not None, whole=not isinstance(error, ChannelsFailed))
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

    def failure(self, slot: int, cause: str) -> Failure:
        """One object failed."""
        path, channel, driver = self._known[slot]
        return Failure(path, channel, cause, driver)

    def _is_late(self, driver: Driver[Any]) -> bool:
        return self.now() - self._late.get(id(driver), -inf) < LATE_TIME + 2 * driver.timeout

    def _moved(self, slot: int, raw: int, kind: Kind) -> None:
        if self.journal is not None:
            self.journal.add(slot, kind, raw, self.raws[slot])
        self.raws[slot] = raw

    def note(
        self, slot: int, kind: Kind, error: ErrorKind = ErrorKind.NONE, raw: int | None = None, time: float = nan
    ) -> None:
        """Into the journal, if one is kept: something happened to this object and its level did not change. `raw` is
        what was to be written, `time` that of what a worker process has brought, or `OF_BLOCK`."""
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
        """The same for many objects, none of them the timer, in this order."""
        if self.journal is not None:
            self.journal.add_each(slots, kind, self._memory, error, raws, time)

    def note_look(self, driver: Driver[Any], found: bool | None) -> None:
        """Into the journal: what a look for a driver that is away has found."""
        slot = next(slot for slot in self._slots_of[id(driver)] if slot != self.timer)
        self.note(slot, Kind.LOOKED, raw=-1 if found is None else int(found))

    def by_driver(self, slots: Iterable[int]) -> list[tuple[Driver[Any], list[int]]]:
        groups: dict[int, tuple[Driver[Any], list[int]]] = {}
        for slot in slots:
            driver = self.wires[slot].driver
            groups.setdefault(id(driver), (driver, []))[1].append(slot)
        return list(groups.values())


def cause_of_failure(error: BaseException) -> str:
    """The cause of a failed call, for an error that ends here: it is left without its frames, since a channel may stay
    broken for a day."""
    cause = text_of(error)
    forget_frames(error)
    return cause


def settling(wired: Wired) -> float:
    """The time in s that a device may take to carry out what was still under way when it began to answer again."""
    return max([SETTLE, *(min(wired.drivers[name].timeout, MAX_SETTLE) for name in wired.hardware)])


def wait_for(seconds: float, pause: Callable[[float], object], on_call: Callable[[], object]) -> None:
    """Wait in slices, each with a sign of life."""
    while seconds > 0:
        on_call()
        pause(min(WAIT_SLICE, seconds))
        seconds -= WAIT_SLICE
