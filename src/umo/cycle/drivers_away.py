"""Drivers that are away: their devices do not answer, and no call waits for them while the machine runs.

After a call that timed out a stand-in replaces the driver, and every call fails immediately. Before a period, at
growing intervals, umo looks for the devices (`Looks.look`, which never waits). A device that answers is initialised
again if it was away for long, and is then called: the first call that succeeds ends the absence. If a whole transfer
fails in another way, umo looks for the device before the next period. Until then the device is called as usual. The
decisions are made in `umo.drivers.absence`. (docs/decisions/0030 and 0098)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from time import monotonic_ns
from typing import Any, NoReturn

from umo.cycle.clock import Clock
from umo.cycle.events import Event, EventLimit, Events, limited
from umo.cycle.segments import DriverSegments
from umo.cycle.stand_ins import Away, NobodyAway, NotCalled, Tried
from umo.cycle.transfer import Transfer
from umo.drivers.absence import ON_CYCLE, Absence, AbsenceState, AbsenceStep
from umo.drivers.contract import Driver
from umo.drivers.optional import answers_for_device, look_for
from umo.duration import duration
from umo.errors import DriverError, Failure, text_of
from umo.text import some
from umo.user_code import attempt


class DriverAway:
    """One driver that has failed and whose device umo looks for."""

    def __init__(self, name: str, driver: Driver[Any]) -> None:
        self.name, self.driver = name, driver
        self.absence = Absence(ON_CYCLE, answers_for_device(driver))
        self.cause = ""
        self.defaulted: dict[str, None] = {}
        """The actuators that the absence has brought to their defaults, where they stay."""
        self.judged = self.told = False
        """Two values: whether the absence has lasted long enough for an event, and whether it had an event, so that its
        end has one, too."""

    def refusal(self) -> NotCalled:
        return NotCalled(f"the driver is away: {self.cause}")


class DriversAway(NobodyAway):
    """The drivers of one running machine that are away."""

    def __init__(
        self,
        transfer: Transfer,
        segments: DriverSegments,
        clock: Clock,
        events: Events,
        initialize: Callable[[int], Failure | None],
        path_if_default_kept: Callable[[int], str],
        slots: Mapping[int, Sequence[int]],
        watchdogs: Mapping[str, float],
    ) -> None:
        """`slots`: the slots of each driver (by id) in the order of initialisation. `path_if_default_kept` returns the
        path of an object that loses its value by the initialisation, or ""."""
        self._transfer, self._segments = transfer, segments
        self._clock, self._events = clock, events
        self._path_if_default_kept = path_if_default_kept
        self._initialize, self._slots, self._watchdogs = initialize, slots, watchdogs
        self._names = {id(driver): name for name, driver in segments.drivers.items()}
        self._away: dict[int, DriverAway] = {}
        self._limits: dict[str, EventLimit] = {}
        self._on_tick = clock.on_tick

    def is_away(self, driver: Driver[Any]) -> bool:
        away = self._away.get(id(driver))
        return away is not None and away.absence.is_away

    def is_unknown(self, driver: Driver[Any]) -> bool:
        return self.is_away(driver) and not self._away[id(driver)].absence.known

    def failed(self, driver: Driver[Any], error: BaseException, timed_out: bool, write: bool) -> None:
        name = self._names.get(id(driver))
        if name is None:  # the timer in real time
            return
        away = self._away.get(id(driver))
        if away is None:
            if not self._away:
                self._on_tick, self._clock.on_tick = self._clock.on_tick, self._look
            away = self._away[id(driver)] = DriverAway(name, driver)
        away.cause = text_of(error)
        self._let_call(away, away.absence.failed(self._clock.now, timed_out, write))

    def end(self) -> None:
        for away in self._away.values():
            self._let_call(away, AbsenceStep.CALL)
        if self._away:
            self._clock.on_tick = self._on_tick
        self._away = {}

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        self._clock.on_tick = instead

    def _look(self) -> None:
        """Look for the devices of the drivers that are away. Called before each period."""
        self._on_tick()
        for away in tuple(self._away.values()):
            if away.absence.is_confirmed:  # nothing was called since it was found
                self._back(away)
            elif away.absence.state is not AbsenceState.TRIED:
                self._tell_away(away)
                if away.absence.is_due(self._clock.now):
                    began = monotonic_ns()
                    self._look_for(away)
                    self.tried(away.name, monotonic_ns() - began)

    def _look_for(self, away: DriverAway) -> None:
        found, error = attempt(_answer, away.driver)
        if error is not None:
            away.cause, found = error.text, False
        self._transfer.note_look(away.driver, found)
        step = away.absence.looked(self._clock.now, found, away.driver.timeout)
        if step is AbsenceStep.INITIALIZE:
            self._let_call(away, AbsenceStep.CALL)
            step = self._initialize_again(away)
        self._let_call(away, step)

    def _let_call(self, away: DriverAway, step: AbsenceStep) -> None:
        """Let calls of the driver go to the driver or to a stand-in, as the step requires."""
        callee: Any = away.driver
        if step is AbsenceStep.REFUSE:
            callee = Away(away.refusal)
        elif step is AbsenceStep.TRY:
            tried, back = partial(self.tried, away.name), partial(self._back, away)
            callee = Tried(away.driver, back, tried, self._transfer.now)
        self._transfer.callees.exchange(away.driver, callee)

    def _initialize_again(self, away: DriverAway) -> AbsenceStep:
        """Initialise every object of the driver and arm its watchdog."""
        why = self._why_not_initialized(away)
        if why:
            away.cause = why
        return away.absence.initialized(self._clock.now, not why)

    def _why_not_initialized(self, away: DriverAway) -> str:
        """Return why initialisation failed, or ""."""
        for slot in self._slots.get(id(away.driver), ()):
            loses = self._path_if_default_kept(slot)
            if (failure := self._initialize(slot)) is not None:
                return failure.cause
            if loses:
                away.defaulted[loses] = None
            away.absence.accepted()
        if away.name in self._watchdogs:
            try:
                self._segments.watchdog(away.name, self._watchdogs[away.name])
            except DriverError as error:
                return text_of(error.__cause__ or error)
        return ""

    def _back(self, away: DriverAway) -> None:
        """End an absence, because a call has succeeded or no call was needed."""
        self._let_call(away, AbsenceStep.CALL)
        del self._away[id(away.driver)]
        if not self._away:
            self._clock.on_tick = self._on_tick
        if away.told:
            self._events.add(partial(_back_event, away, self._clock.now), logged=True)

    def _tell_away(self, away: DriverAway) -> None:
        """Report an absence once, when it has lasted long enough. Only a few absences a minute are reported."""
        if not away.judged and away.absence.has_lasted(self._clock.now):
            away.judged = True
            limit = self._limits.setdefault(away.name, EventLimit())
            if (left_out := limit.admit(self._clock.now)) is not None:
                away.told = True
                self._events.add(partial(_away_event, away, self._clock.now, left_out), logged=True)


def _answer(driver: Driver[Any]) -> bool | None:
    """Return the result of a look. The call begins in this file: `insisting.CALLERS`."""
    return look_for(driver)


def _away_event(away: DriverAway, now: float, left_out: int) -> Event:
    """Return the event that an absence has lasted long enough to be reported."""
    return limited(now, f"driver {away.name}", f"is away: {away.cause}", left_out)


def _back_event(away: DriverAway, now: float) -> Event:
    """Return the event that a driver is back."""
    again = f", initialised again{_at_defaults(list(away.defaulted))}" if away.absence.was_initialized else ""
    text = f"is back after {duration(round(now - away.absence.began, 6))}{again}"
    return Event(now, f"driver {away.name}", text)


def _at_defaults(paths: Sequence[str]) -> str:
    """Return which actuators are at their defaults, as text; "" if none is."""
    if not paths:
        return ""
    return f"; {some(paths)} {'is at its default' if len(paths) == 1 else 'are at their defaults'}"


def in_order(slots: Iterable[int], drivers: Sequence[Driver[Any]]) -> dict[int, list[int]]:
    """Return the slots of each driver, by its id, in the order given. `drivers` contains the driver of every slot."""
    found: dict[int, list[int]] = {}
    for slot in slots:
        found.setdefault(id(drivers[slot]), []).append(slot)
    return found
