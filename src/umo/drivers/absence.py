"""The absence of a device, as a state machine without a clock and without a driver.

It is told what has happened at which time, and says what is to be done. The cycle has one for each driver that is away
(`umo.cycle.drivers_away`), the server of a driver off the cycle one of its own. (docs/decisions/0098)
"""

from __future__ import annotations

from enum import Enum, auto
from math import inf
from typing import NamedTuple

FIRST_INTERVAL = 0.05
"""Time in s until a device is looked for again, after the first look or try that was in vain; it doubles each time."""
LONG_ABSENCE = 0.5
"""Time in s of an absence after which it is told, and its device initialised again: it may have been switched off. A
lost answer must not bring an output to its default, nor a device that is busy now and then fill the events."""
ROUNDING = 1e-9
"""Time in s by which a period may come early: the machine's time is a sum of periods."""


class AbsenceState(Enum):
    """What is known of a device."""

    THERE = auto()
    """It answers, as far as is known."""
    DOUBTED = auto()
    """A call has failed at once: calls are made as ever until it has been looked for."""
    AWAY = auto()
    """No call is made."""
    TRIED = auto()
    """It was found: the next call decides."""


class AbsenceStep(Enum):
    """What is to be done."""

    CALL = auto()
    """Calls are made."""
    REFUSE = auto()
    """Calls are refused."""
    INITIALIZE = auto()
    """It is initialised again, and the outcome told (`initialized`), before anything is sent to it."""
    TRY = auto()
    """Calls are made, and the outcome of the first one is told (`failed`, or the absence is over)."""


class Manner(NamedTuple):
    """What differs between those who look for a device."""

    max_interval: float
    """The longest time in s from one look or try to the next."""
    calls_on: bool
    """Whether calls are made as ever after one that has failed at once."""


ON_CYCLE = Manner(5.0, True)
"""A try may cost a period the timeout of a call; a call that fails at once costs nothing."""
OFF_CYCLE = Manner(1.0, False)
"""Nobody waits for a try; nothing is written to a device of which nothing has arrived."""


class Absence:
    """The absence of one device. All times are in s, by whatever clock."""

    def __init__(self, manner: Manner, answers: bool) -> None:
        """`answers`: whether a look that finds the device has its own answer; else it says that it may be tried."""
        self._manner, self._answers = manner, answers
        self.state = AbsenceState.THERE
        self.began = self.due = inf
        """Time at which it has begun; time from which the device is looked for."""
        self.known = False
        """Whether it is known that the device is away: a write has failed, or it was not found."""
        self.was_initialized = False
        """Whether the device was initialised in this absence."""
        self.refuses = False
        """Whether the device is there and refuses: it has answered the last look, and calls have failed at once."""
        self._since = inf
        """Time since which the device is not known to answer."""
        self._undecided = inf
        """Time since which looks for it have not decided; inf: the last one has."""
        self._interval = FIRST_INTERVAL
        self._accepted = False
        """Whether the device has accepted some of an initialisation: it is there."""

    @property
    def is_away(self) -> bool:
        """Whether calls are refused."""
        return self.state is AbsenceState.AWAY

    @property
    def is_confirmed(self) -> bool:
        """Whether a device that was found is there, also if nothing was called since."""
        return self.state is AbsenceState.TRIED and self._answers

    def has_lasted(self, now: float) -> bool:
        """Whether it is long enough to be told."""
        return now - self.began >= LONG_ABSENCE - ROUNDING

    def is_due(self, now: float) -> bool:
        """Whether the device is to be looked for."""
        return self.state is AbsenceState.DOUBTED or (self.is_away and now >= self.due - ROUNDING)

    def assume(self, now: float) -> None:
        """Nothing is known of the device: it is initialised before anything is sent."""
        self.state, self.began, self.due, self._since = AbsenceState.AWAY, now, now, -inf

    def failed(self, now: float, timed_out: bool, write: bool = False, began: float | None = None) -> AbsenceStep:
        """A call has failed: one of the whole driver, or one that timed out. `began`: the time at which the call has
        begun, if that is not now."""
        if self.state is AbsenceState.THERE:
            self.began = self.due = self._since = now if began is None else began
        answered = not timed_out and self._answers
        self.known |= write
        self.refuses &= answered
        refuse = timed_out or not self._manner.calls_on
        if self.state is AbsenceState.TRIED:
            if answered:
                self.refuses, self._since = True, now  # it was not switched off meanwhile
            if refuse or self.was_initialized:
                return self._wait(now)
        if self.state is not AbsenceState.AWAY:
            self.state = AbsenceState.AWAY if refuse else AbsenceState.DOUBTED
        return AbsenceStep.REFUSE if self.is_away else AbsenceStep.CALL

    def looked(self, now: float, found: bool | None, timeout: float) -> AbsenceStep:
        """The device was looked for. None, "not known yet", counts as False after the `timeout` of a call in s, or a
        long absence if that is longer."""
        if found is None:
            self._undecided = min(self._undecided, now)
            if now - self._undecided <= max(timeout, LONG_ABSENCE) + ROUNDING:
                self.state, self.due = AbsenceState.AWAY, now
                return AbsenceStep.REFUSE
        self._undecided = inf
        if not found:
            self.refuses = False
            return self._wait(now)
        if now - self._since >= LONG_ABSENCE - ROUNDING and not self.refuses:
            return AbsenceStep.INITIALIZE
        return self._try()

    def accepted(self) -> None:
        """The device has accepted some of an initialisation. It is tried soon, once: what fails each time is tried at
        growing intervals."""
        if not self._accepted:
            self._accepted, self._interval = True, FIRST_INTERVAL

    def initialized(self, now: float, complete: bool) -> AbsenceStep:
        """It was initialised again, or not completely."""
        if not complete:
            return self._wait(now)
        self.was_initialized = True
        self._since = now
        return self._try()

    def _try(self) -> AbsenceStep:
        self.state, self.known = AbsenceState.TRIED, True
        return AbsenceStep.TRY

    def _wait(self, now: float) -> AbsenceStep:
        """Until it is looked for again."""
        self.state, self.known = AbsenceState.AWAY, True
        self.due, self._interval = now + self._interval, min(2 * self._interval, self._manner.max_interval)
        return AbsenceStep.REFUSE
