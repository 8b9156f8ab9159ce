"""Drivers that are away: their devices do not answer, and no call waits for them while the machine runs.

A call that timed out puts a stand-in in the place of its driver: every call fails at once. Before each period the
devices are looked for (`Looks.look`, which never waits), at growing intervals. One that answers is initialised again
if it was away for long, and tried: the first call that succeeds ends the absence. Another failure of a whole transfer
lets the driver be looked for before the next period; until then it is called as ever. (docs/decisions/0030)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from time import monotonic_ns
from typing import Any, NoReturn, Protocol

from umo.cycle.clock import Clock
from umo.cycle.events import Event, EventLimit, Events, limited
from umo.cycle.stand_ins import Away, NotCalled, Tried
from umo.drivers.contract import Driver
from umo.drivers.optional import answers_for_device, look_for
from umo.errors import DriverError, Failure, text_of
from umo.presentation.durations import duration
from umo.text import some
from umo.user_code import attempt

FIRST_INTERVAL = 0.05
"""Time in s until a driver is looked for again, after the first look or try that was in vain."""
MAX_INTERVAL = 5.0
"""Maximum of the same: it doubles each time."""
LONG_ABSENCE = 0.5
"""Time in s of an absence after which it is told, and its device initialised again: it may have been switched off. A
lost answer must not bring an output to its default, nor a device that is busy now and then fill the events."""


ROUNDING = 1e-9
"""Time in s by which a period may come early: the machine's time is a sum of periods."""


class Drivers(Protocol):
    """The transfer stage, as far as absences need it."""

    @property
    def drivers(self) -> Mapping[str, Driver[Any]]: ...

    @property
    def now(self) -> Callable[[], float]:
        """The clock in s by which a call has taken too long."""

    def exchange(self, driver: Driver[Any], callee: Any) -> None:
        """Let calls of this driver go to `callee` from now on."""

    def watchdog(self, name: str, seconds: float) -> None:
        """Arm the driver's watchdog."""

    def note_look(self, driver: Driver[Any], found: bool | None) -> None:
        """Note what a look for this driver has found."""


class Absence:
    """One driver that has failed."""

    def __init__(self, name: str, driver: Driver[Any], since: float, known: bool) -> None:
        self.name, self.driver = name, driver
        self.since = since
        """Time in s on the cycle's clock since which it is not known to answer."""
        self.answers_for_device = answers_for_device(driver)
        """Whether its `look` knows that the device answers; else that it may be tried."""
        self.began = since
        self.cause = ""
        self.shut = False
        """Whether its calls are refused."""
        self.trial = False
        """Whether it was found, and no call has succeeded yet."""
        self.initialized = False
        """Whether it was initialised since."""
        self.defaulted: dict[str, None] = {}
        """The actuators that this has brought to their defaults, where they stay."""
        self.answered = False
        """Whether an initialisation has succeeded for some of its objects at least: it is there."""
        self.known = known
        """Whether it is known that it is away: a write has failed, or it was not found."""
        self.judged = self.told = False
        """Whether it has lasted long enough to be told; whether it was told, so that its end is."""
        self.due = since
        """Time in s from which it is looked for."""
        self.interval = FIRST_INTERVAL
        self.undecided = math.inf
        """Time in s since which looks for it have not decided; inf: the last one has."""

    def refusal(self) -> NotCalled:
        return NotCalled(f"it is away: {self.cause}")

    def shut_for_now(self, now: float) -> None:
        self.shut, self.trial = True, False
        self.due, self.interval = now + self.interval, min(2 * self.interval, MAX_INTERVAL)


class Absences:
    """The drivers of one running machine that are away."""

    def __init__(
        self,
        transfer: Drivers,
        clock: Clock,
        events: Events,
        initialize: Callable[[int], Failure | None],
        stays_at_default: Callable[[int], str],
        slots: Mapping[int, Sequence[int]],
        watchdogs: Mapping[str, float],
    ) -> None:
        """`slots` are those of each driver (by id) in the order in which they are initialised. `stays_at_default` is
        the path of an object that loses its value by this, else ""."""
        self._transfer, self._clock, self._events = transfer, clock, events
        self._stays_at_default = stays_at_default
        self._initialize, self._slots, self._watchdogs = initialize, slots, watchdogs
        self._names = {id(driver): name for name, driver in transfer.drivers.items()}
        self._absent: dict[int, Absence] = {}
        self._limits: dict[str, EventLimit] = {}
        self._on_tick = clock.on_tick
        self.tried: Callable[[str, int], object] = lambda name, ns: None
        """Function that is told the ns that a driver has taken as it was looked for or tried, by its name."""

    def is_away(self, driver: Driver[Any]) -> bool:
        """Whether calls of this driver are refused."""
        absence = self._absent.get(id(driver))
        return absence is not None and absence.shut

    def is_unknown(self, driver: Driver[Any]) -> bool:
        """Whether calls of this driver are refused, and it is not known yet whether its device answers."""
        absence = self._absent.get(id(driver))
        return absence is not None and absence.shut and not absence.known

    def failed(self, driver: Driver[Any], error: BaseException, timed_out: bool, write: bool) -> None:
        """A call has failed by this error: one of the whole driver, or one that timed out."""
        name = self._names.get(id(driver))
        if name is None:  # the timer in real time
            return
        absence = self._absent.get(id(driver))
        if absence is None:
            if not self._absent:
                self._on_tick, self._clock.on_tick = self._clock.on_tick, self._look
            absence = self._absent[id(driver)] = Absence(name, driver, self._clock.now, known=write)
        absence.cause = text_of(error)
        absence.known |= write
        if absence.trial:
            if timed_out or absence.initialized:
                absence.shut_for_now(self._clock.now)
            elif absence.answers_for_device:
                absence.since = self._clock.now  # it has answered: it was not switched off meanwhile
        absence.trial = False
        absence.shut |= timed_out
        self._transfer.exchange(driver, Away(absence.refusal) if absence.shut else driver)

    def end(self) -> None:
        """Every driver is called again, whether it answers or not: the machine stops."""
        for absence in self._absent.values():
            self._transfer.exchange(absence.driver, absence.driver)
        if self._absent:
            self._clock.on_tick = self._on_tick
        self._absent = {}

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """No device is looked for any more: in place of that `instead` is called."""
        self._clock.on_tick = instead

    def _look(self) -> None:
        """Before each period, while any driver is away."""
        self._on_tick()
        for absence in tuple(self._absent.values()):
            if absence.trial:
                if absence.answers_for_device:  # nothing was called since it was found
                    self._back(absence)
                continue
            self._tell_away(absence)
            if not absence.shut or self._clock.now >= absence.due - ROUNDING:
                began = monotonic_ns()
                self._look_for(absence)
                self.tried(absence.name, monotonic_ns() - began)

    def _look_for(self, absence: Absence) -> None:
        found, error = attempt(_answer, absence.driver)
        if error is not None:
            absence.cause, found = error.text, False
        self._transfer.note_look(absence.driver, found)
        if found is None and self._is_awaited(absence):
            absence.shut = True  # until it is known
            self._transfer.exchange(absence.driver, Away(absence.refusal))
            return
        absence.undecided = math.inf
        if not (found and self._found(absence)):
            absence.known = True
            absence.shut_for_now(self._clock.now)
            self._transfer.exchange(absence.driver, Away(absence.refusal))

    def _is_awaited(self, absence: Absence) -> bool:
        """Whether a look that has not decided may still do so: it has the time of a call, or that of a long absence."""
        absence.undecided = min(absence.undecided, self._clock.now)
        limit = max(absence.driver.timeout, LONG_ABSENCE)
        return self._clock.now - absence.undecided <= limit + ROUNDING

    def _found(self, absence: Absence) -> bool:
        """The device may be tried; whether it is ready for that."""
        now, driver = self._clock.now, absence.driver
        if now - absence.since >= LONG_ABSENCE - ROUNDING:
            self._transfer.exchange(driver, driver)
            if why := self._initialize_again(absence):
                absence.cause = why
                return False
            absence.initialized, absence.since = True, now
        absence.shut, absence.trial, absence.known = False, True, True
        self._transfer.exchange(driver, self._trial(absence))
        return True

    def _trial(self, absence: Absence) -> Tried:
        return Tried(
            absence.driver, lambda: self._back(absence), lambda ns: self.tried(absence.name, ns), self._transfer.now
        )

    def _initialize_again(self, absence: Absence) -> str:
        """Initialise every object of the driver and arm its watchdog; why that failed, or ""."""
        for slot in self._slots.get(id(absence.driver), ()):
            loses = self._stays_at_default(slot)
            if (failure := self._initialize(slot)) is not None:
                return failure.cause
            if loses:
                absence.defaulted[loses] = None
            if not absence.answered:  # once: what fails each time is tried at growing intervals
                absence.answered, absence.interval = True, FIRST_INTERVAL
        if absence.name in self._watchdogs:
            try:
                self._transfer.watchdog(absence.name, self._watchdogs[absence.name])
            except DriverError as error:
                return text_of(error.__cause__ or error)
        return ""

    def _back(self, absence: Absence) -> None:
        """A call has succeeded, or none was needed."""
        self._transfer.exchange(absence.driver, absence.driver)
        del self._absent[id(absence.driver)]
        if not self._absent:
            self._clock.on_tick = self._on_tick
        if absence.told:
            self._events.add(partial(_back_event, absence, self._clock.now), logged=True)

    def _tell_away(self, absence: Absence) -> None:
        """Once, when it has lasted; a few times a minute."""
        if not absence.judged and self._clock.now - absence.began >= LONG_ABSENCE - ROUNDING:
            absence.judged = True
            limit = self._limits.setdefault(absence.name, EventLimit())
            if (left_out := limit.admit(self._clock.now)) is not None:
                absence.told = True
                self._events.add(partial(_away_event, absence, self._clock.now, left_out), logged=True)


def _answer(driver: Driver[Any]) -> bool | None:
    """What its look says. The call begins in this file: `insisting.CALLERS`."""
    return look_for(driver)


def _away_event(absence: Absence, now: float, left_out: int) -> Event:
    """An absence has lasted."""
    return limited(now, f"driver {absence.name}", f"is away: {absence.cause}", left_out)


def _back_event(absence: Absence, now: float) -> Event:
    """A driver has ended its absence."""
    again = f", initialised again{_at_defaults(list(absence.defaulted))}" if absence.initialized else ""
    text = f"is back after {duration(round(now - absence.began, 6))}{again}"
    return Event(now, f"driver {absence.name}", text)


def _at_defaults(paths: Sequence[str]) -> str:
    """Which actuators are at their defaults; "" if there are none."""
    if not paths:
        return ""
    return f"; {some(paths)} {'is at its default' if len(paths) == 1 else 'are at their defaults'}"


def in_order(slots: Iterable[int], drivers: Sequence[Driver[Any]]) -> dict[int, list[int]]:
    """The slots of each driver, by its id, in the order given; `drivers` are those of all slots."""
    found: dict[int, list[int]] = {}
    for slot in slots:
        found.setdefault(id(drivers[slot]), []).append(slot)
    return found
