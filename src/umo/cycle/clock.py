"""The cycle's clock: time in s, counted in ticks of the wired timer."""

from __future__ import annotations

import time
from collections.abc import Callable


class Clock:
    """The clock that counts the timer's ticks. Time stands still between two ticks, so a run in virtual time can be
    repeated exactly."""

    __slots__ = ("dt", "missed", "missed_in_all", "now", "number", "on_tick", "period", "ticks")

    def __init__(self, period: float) -> None:
        self.period = period
        """The sampling period in s."""
        self.ticks = 1
        """The number of ticks that the last reading of the timer consumed."""
        self.missed = 0
        """The result of the last reading of the timer."""
        self.missed_in_all = 0
        """Number of periods missed since connecting."""
        self.number = 0
        """Number of ticks since connecting."""
        self.now = 0.0
        self.dt = period
        self.on_tick: Callable[[], None] = lambda: None
        """The function that is called when the timer has returned, while the clock still shows the previous period."""

    def read(self) -> float:
        """Return the time in s for a reading that is made now."""
        return self.now

    def advance(self, missed: int) -> None:
        """Advance after reading the timer. The reading is 0 after the timer blocked for one tick, otherwise the number
        of ticks that had already passed."""
        self.on_tick()
        if missed:
            self.missed_in_all += missed
        self.missed = missed
        self.ticks = missed if missed > 1 else 1
        self.number += self.ticks
        self.now = self.number * self.period
        self.dt = self.ticks * self.period


class WallClock(Clock):
    """The clock of a machine without a timer: seconds since connecting, read when the whole machine is sampled."""

    __slots__ = ("_source", "_start")

    def __init__(self, source: Callable[[], float] = time.monotonic) -> None:
        super().__init__(0.0)
        self._source = source
        self._start = source()

    def read(self) -> float:
        return self._source() - self._start

    def look(self) -> None:
        """Begin a period: `dt` becomes the time since the previous period."""
        self.on_tick()
        now = self._source() - self._start
        self.number += 1
        self.dt, self.now = now - self.now, now
