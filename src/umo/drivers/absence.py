"""The absence of a device, as a state machine without a clock and without a driver.

It receives events with their times, and returns what to do. The cycle has a state machine for each driver that is away
(`umo.cycle.drivers_away`); the server of a driver off the cycle has another one. (docs/decisions/0098)
"""

from __future__ import annotations

from enum import Enum, auto
from math import inf
from typing import NamedTuple

from umo.duration import TIME_TOLERANCE

FIRST_INTERVAL = 0.05
"""The time in s until umo looks for a device again after the first look or attempt that failed. The time is doubled
after each further failure."""
LONG_ABSENCE = 0.5
"""The time in s from which on an absence is recorded as an event, and the device is initialised again, because it may
have been switched off. A lost answer must not bring an output to its default, and a device that is sometimes busy must
not fill the events."""


class AbsenceState(Enum):
    """The state of a device."""

    THERE = auto()
    """No call has failed since the device last answered: the device counts as present."""
    DOUBTED = auto()
    """A call has failed immediately. Calls are made as usual until umo has looked for the device."""
    AWAY = auto()
    """The device is away: no call is made."""
    TRIED = auto()
    """The device was found; the next call decides whether the absence is over."""


class AbsenceStep(Enum):
    """The next step of the caller."""

    CALL = auto()
    """Calls are made."""
    REFUSE = auto()
    """Calls are refused."""
    INITIALIZE = auto()
    """Initialise the device again before anything else is sent to it, and report the outcome (`initialized`)."""
    TRY = auto()
    """Make calls. If the first call fails, call `failed`; otherwise the absence is over."""


class SearchPolicy(NamedTuple):
    """The differences between the callers that look for a device."""

    max_interval: float
    """The longest time in s from one look or attempt to the next."""
    calls_on: bool
    """True if calls are made as usual after a call that has failed immediately."""


ON_CYCLE = SearchPolicy(5.0, True)
"""The policy on the cycle: an attempt may delay a period by the timeout of a call; a call that fails immediately takes
no time."""
OFF_CYCLE = SearchPolicy(1.0, False)
"""The policy off the cycle: nothing waits for an attempt. Nothing is written to a device before one of its values has
arrived."""


class Absence:
    """The absence of one device. All times are in s on the same clock, which may be any clock."""

    def __init__(self, manner: SearchPolicy, answers: bool) -> None:
        """`answers`: True if a successful look proves that the device answers; otherwise it only shows that a call may
        be tried."""
        self._manner, self._answers = manner, answers
        self.state = AbsenceState.THERE
        self.began = self.due = inf
        """The time at which the absence has begun, and the time from which on umo looks for the device."""
        self.known = False
        """True if it is known that the device is away: a write has failed, or the device was not found."""
        self.was_initialized = False
        """True if the device was initialised in this absence."""
        self.refuses = False
        """True if the device is present but refuses calls: it has answered the last look, and calls have failed
        immediately."""
        self._since = inf
        """The time since which it is not known that the device answers."""
        self._undecided = inf
        """The time since which looks have not decided whether the device answers; inf if the last look has decided
        it."""
        self._interval = FIRST_INTERVAL
        self._accepted = False
        """True if the device has accepted a part of an initialisation and is therefore present."""

    @property
    def is_away(self) -> bool:
        """True if calls are refused."""
        return self.state is AbsenceState.AWAY

    @property
    def is_confirmed(self) -> bool:
        """True if it is certain that a found device is present, even if no call was made since the look."""
        return self.state is AbsenceState.TRIED and self._answers

    def has_lasted(self, now: float) -> bool:
        """Return True if the absence is long enough for an event."""
        return now - self.began >= LONG_ABSENCE - TIME_TOLERANCE

    def is_due(self, now: float) -> bool:
        """Return True if it is time to look for the device."""
        return self.state is AbsenceState.DOUBTED or (self.is_away and now >= self.due - TIME_TOLERANCE)

    def assume(self, now: float) -> None:
        """Assume nothing about the device, so that it is initialised before anything is sent."""
        self.state, self.began, self.due, self._since = AbsenceState.AWAY, now, now, -inf

    def failed(self, now: float, timed_out: bool, write: bool = False, began: float | None = None) -> AbsenceStep:
        """Record a call that failed for the whole driver, or that timed out. `began`: the time at which the call began,
        if it did not begin now."""
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
        """Record the result of a look. None, "not known yet", counts as False after the `timeout` of a call in s, or
        after `LONG_ABSENCE` if that is longer."""
        if found is None:
            self._undecided = min(self._undecided, now)
            if now - self._undecided <= max(timeout, LONG_ABSENCE) + TIME_TOLERANCE:
                self.state, self.due = AbsenceState.AWAY, now
                return AbsenceStep.REFUSE
        self._undecided = inf
        if not found:
            self.refuses = False
            return self._wait(now)
        if now - self._since >= LONG_ABSENCE - TIME_TOLERANCE and not self.refuses:
            return AbsenceStep.INITIALIZE
        return self._try()

    def accepted(self) -> None:
        """Record that the device has accepted a part of an initialisation. The initialisation is tried again soon, but
        only once; if it fails each time, the intervals grow."""
        if not self._accepted:
            self._accepted, self._interval = True, FIRST_INTERVAL

    def initialized(self, now: float, complete: bool) -> AbsenceStep:
        """Record that the device was initialised again, completely or not."""
        if not complete:
            return self._wait(now)
        self.was_initialized = True
        self._since = now
        return self._try()

    def _try(self) -> AbsenceStep:
        self.state, self.known = AbsenceState.TRIED, True
        return AbsenceStep.TRY

    def _wait(self, now: float) -> AbsenceStep:
        """Treat the device as away until the next look."""
        self.state, self.known = AbsenceState.AWAY, True
        self.due, self._interval = now + self._interval, min(2 * self._interval, self._manner.max_interval)
        return AbsenceStep.REFUSE
