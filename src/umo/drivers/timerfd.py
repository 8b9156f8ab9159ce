"""The real-time clock of Linux as a sensor: the paper's `Timer_Input` (section 5.3) on timerfd_create(2)."""

from __future__ import annotations

import ctypes
import os
import select
import sys
import time
from collections.abc import Callable

from umo.drivers.contract import Channel, Direction, Driver
from umo.errors import DriverError

CLOCK_MONOTONIC = 1
TFD_TIMER_ABSTIME = 1
TFD_CLOEXEC = getattr(os, "O_CLOEXEC", 0)


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


class _Itimerspec(ctypes.Structure):
    _fields_ = [("interval", _Timespec), ("value", _Timespec)]


def _timespec(nanoseconds: int) -> _Timespec:
    return _Timespec(*divmod(nanoseconds, 1_000_000_000))


class Ticker:
    """A grid of periods on the monotonic clock. `expired` is injected by tests.

    `expired(block)` returns how many ticks have passed since it was last asked; with block=False possibly 0,
    with block=True at least 1.
    """

    def __init__(self, period: float, expired: Callable[[bool], int] | None = None) -> None:
        self.period = period
        self._expired = expired or self._read
        self._late = 0  # ticks that passed between the wake-up and the look at the counter
        self._fd = -1
        self._passed: Callable[[int], object] = lambda timeout: ()
        self._nanoseconds = round(period * 1e9)
        self._next = 0
        self.due = 0
        """When the tick that ended the last `wait` was due, in ns of CLOCK_MONOTONIC."""
        self.woke = 0
        """When the last `wait` went on, on the same clock: `woke - due` is how late it woke."""

    def start(self) -> None:
        """The first tick comes one period from now."""
        if not sys.platform.startswith("linux"):
            raise DriverError("real time needs Linux (timerfd); virtual time works everywhere")
        libc = ctypes.CDLL(None, use_errno=True)
        self._fd = libc.timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC)
        if not self._nanoseconds:  # which timerfd takes for "never"
            raise DriverError(f"timerfd: the period is {self.period:g} s; give the timer a period in its wiring")
        self._next = time.monotonic_ns() + self._nanoseconds
        spec = _Itimerspec(_timespec(self._nanoseconds), _timespec(self._next))
        if self._fd < 0 or libc.timerfd_settime(self._fd, TFD_TIMER_ABSTIME, ctypes.byref(spec), None) < 0:
            number = ctypes.get_errno()
            raise DriverError(f"timerfd: {os.strerror(number)} (period {self.period:g} s)")
        waiting = select.poll()  # select.select takes no descriptor above 1023
        waiting.register(self._fd, select.POLLIN)
        self._passed = waiting.poll

    def wait(self) -> int:
        """As in the paper: return at once the ticks that have passed since the last call; if there were none, block
        until the next tick and return 0. A missed tick does not shift the following ticks."""
        before, self._late = self._late, 0
        passed = before + self._pass(self._expired(False))
        if passed:
            self.woke = time.monotonic_ns()
            return passed
        first = self._next
        self._late = self._pass(self._expired(True)) - 1
        self.woke = time.monotonic_ns()
        self.due = first
        return 0

    def close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _pass(self, ticks: int) -> int:
        self._next += ticks * self._nanoseconds
        self.due = self._next - self._nanoseconds
        return ticks

    def _read(self, block: bool) -> int:
        if not block and not self._passed(0):
            return 0
        return int.from_bytes(os.read(self._fd, 8), sys.byteorder)


class TimerFd(Driver):
    """One channel, the tick; `read` blocks until the next sampling period and returns the ticks missed."""

    realtime = True

    def __init__(self) -> None:
        self.ticker: Ticker | None = None
        """The running grid."""

    def channel(self, text: str) -> Channel:
        return Channel("tick", Direction.INPUT, 63)

    def initialize(self, channel: Channel, default: int | None) -> None:
        self.ticker = Ticker(self.period)
        self.ticker.start()

    def finalize(self, channel: Channel) -> None:
        if self.ticker is not None:
            self.ticker.close()

    def reset(self, channel: Channel, default: int | None) -> None:
        """A timer has no faults to clear, and its grid never moves."""

    def read(self, channel: Channel) -> int:
        if self.ticker is None:
            raise DriverError("the timer is not running")
        return self.ticker.wait()
