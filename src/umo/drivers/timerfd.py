"""The real-time clock of Linux as a sensor: the paper's `Timer_Input` (section 5.3) on timerfd_create(2)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.optional import EndsWait, MovesInC, TransferInC, WaitEnded
from umo.drivers.transfers_in_c import NOT_BUILT, native
from umo.duration import duration
from umo.errors import DriverError
from umo.system import calls

MAX_AWAKE_SHARE = 15 / 16
"""The largest share of its processor that a busily waiting thread may use. The kernel suspends a real-time thread that
uses more than 95 % (sched(7), sched_rt_runtime_us)."""
LOOK_INTERVAL = 10, 30_000_000
"""The interval in periods, and the longest interval in ns, between two readings of the processor time. A reading is a
system call that would lengthen each period."""
MAX_OWED_SLEEP = 1, 2_000_000
"""The missing sleep in periods, and the longest missing sleep in ns, that may accumulate before the thread sleeps until
a tick."""
MAX_NAP = 50_000_000
"""The longest sleep in ns before a check whether a stop has ended the wait."""
LEFT_OUT_PERIODS = 8
"""The number of periods for which work is left out after it did not end before its tick. The number is doubled each
time that this happens in succession."""
MAX_DOUBLINGS = 12
"""Largest number of doublings of this number of periods."""
DECAY_DIVISOR = 8
"""Divisor for the decrease of the expected time of the work in each period after a long one."""


class WhileWaiting:
    """Work that is done during the wait for a tick, if it is likely to end before the tick."""

    def __init__(self, work: Callable[[], object], clock: Callable[[], int] | None = None) -> None:
        self._work = work
        self._clock = clock or calls.now_ns
        self._took = 0
        """The expected duration of the work in ns: the longest recent duration."""
        self._overran = 0
        """The number of successive times that the work did not end before its tick."""
        self._left_out = 0
        """The number of periods until the work is done again after this."""

    def __call__(self, now: int, due: int) -> int:
        """Do the work if it fits between now and the tick. Return the time afterwards, in ns."""
        if self._left_out:
            self._left_out -= 1
            return now
        if due - now <= self._took:
            self._took -= self._took // DECAY_DIVISOR
            return now
        self._work()
        after = self._clock()
        if after <= due:
            self._took, self._overran = max(after - now, self._took - self._took // DECAY_DIVISOR), 0
        else:
            self._left_out = LEFT_OUT_PERIODS << self._overran
            self._overran = min(self._overran + 1, MAX_DOUBLINGS)
        return after


Grid: Any = object if native is None else native.Grid
"""The memory for the numbers of a `Ticker`, which the extension shares. `TICK` of the extension waits like
`Ticker.wait`."""


class Ticker(Grid):  # type: ignore[misc]
    """A grid of periods on the monotonic clock. `clock` (ns), `used` (ns), `sleep` and `nap` can be injected by tests;
    otherwise the functions of `calls` are taken once, at construction, because they are called in every period.

    `sleep()` returns after the next expiry of the kernel's timer, or immediately if the timer has expired since the
    last call. The clock determines which ticks have passed. `nap(s)` is time.sleep, `used()` the processor time of this
    thread.
    """

    def __init__(
        self,
        period: float,
        clock: Callable[[], int] | None = None,
        sleep: Callable[[], object] | None = None,
        nap: Callable[[float], object] | None = None,
        used: Callable[[], int] | None = None,
    ) -> None:
        read_timer = calls.read
        self.period = period
        self._clock = clock or calls.now_ns
        self._sleep = sleep or (lambda: read_timer(self._fd, 8))
        self._nap = nap or calls.sleep
        self._used = used or calls.processor_ns
        self._fd = -1
        self._nanoseconds = round(period * 1e9)
        self._next = self._clock() + self._nanoseconds
        self._look_after = min(LOOK_INTERVAL[0] * self._nanoseconds, LOOK_INTERVAL[1])
        self._bearable = min(MAX_OWED_SLEEP[0] * self._nanoseconds, MAX_OWED_SLEEP[1])
        self._looked = self._used_then = 0
        """The time and the processor time used when `_is_tired` looked last, in ns."""
        self._awake_share = MAX_AWAKE_SHARE
        self._owed = 0.0
        """The sleep in ns that the thread should have had by this time but has not had."""
        self._napped = 0
        """The sleep in ns that the thread has had, because it was missing, since `_is_tired` looked last."""
        self._busy_wait = 0
        self._ended = False
        """True if the present wait, or the next one, must end."""
        self.meanwhile: WhileWaiting | None = None
        """The work that is done between waking up and the tick."""
        self.due = 0
        """The time in ns of CLOCK_MONOTONIC at which the tick that ended the last `wait` was due."""
        self.woke = 0
        """Time at which the last `wait` continued, on the same clock: `woke - due` is the delay of waking up."""

    def start(self) -> None:
        """Start the timer: the first tick comes one period from now."""
        if not sys.platform.startswith("linux"):
            raise DriverError("real time needs Linux (timerfd); virtual time works everywhere")
        if not self._nanoseconds:  # which timerfd takes for "never"
            raise DriverError(f"timerfd: the period is {duration(self.period)}; give the timer a period in its wiring")
        self._next = self._clock() + self._nanoseconds
        try:
            self._fd = calls.make_timer()
        except OSError as error:
            raise self._refused(error) from None
        self._arm_or_raise(self._next)

    def wait_busily(self, seconds: float) -> None:
        """Sleep until this time in s before each tick, then read the clock until the tick comes, so that the thread and
        its processor are awake. This takes a corresponding share of a processor. If this share and the work of the
        periods exceed `MAX_AWAKE_SHARE`, the thread sleeps until the tick in some of the periods."""
        self._busy_wait = round(seconds * 1e9)
        self._arm_or_raise(self._next - self._busy_wait)

    def wait(self) -> int:
        """Return immediately the number of ticks that have passed since the last call, as in the paper. If there were
        none, block until the next tick and return 0. A missed tick does not shift the following ticks. Raises WaitEnded
        after `stop_waiting`."""
        clock, due = self._clock, self._next
        now = clock()
        if now >= due:
            passed = (now - due) // self._nanoseconds + 1
            self._next = due + passed * self._nanoseconds
            self.due, self.woke = self._next - self._nanoseconds, now
            return passed
        wake_at = due - self._busy_wait
        if self._busy_wait and self._is_tired(now):
            self._napped += due - now
            while now < due and not self._ended:
                self._nap(min(due - now, MAX_NAP) * 1e-9)
                now = clock()
        while now < wake_at:
            if self._ended:  # this once: a loop that goes on all the same keeps its pace
                self._ended = False
                self._arm(self._next - self._busy_wait)
                raise WaitEnded
            self._sleep()
            now = clock()
        if self.meanwhile is not None and now < due:
            now = self.meanwhile(now, due)
        while now < due:
            now = clock()
        self._next = due + self._nanoseconds
        self.due, self.woke = due, now
        return 0

    def stop_waiting(self) -> None:
        """End this wait, or the next one, by making the kernel's timer expire immediately. This function raises no
        error."""
        self._ended = True
        self._arm(1)

    def close(self) -> None:
        file, self._fd = self._fd, -1
        if file >= 0:
            calls.close(file)

    def _is_tired(self, now: int) -> bool:
        """Return True if the thread has missed more sleep than it may (`MAX_OWED_SLEEP`)."""
        then = self._looked
        if now - then >= self._look_after:
            used = self._used()
            self._owed = max(self._owed + (used - self._used_then) - MAX_AWAKE_SHARE * (now - then), 0.0)
            self._looked, self._used_then, self._napped = now, used, 0
        return self._owed - self._napped > self._bearable

    def _arm(self, first: int) -> OSError | None:
        """Let the kernel's timer, if there is one, expire at this time of the clock, and then once per period. Return
        the error if the kernel refuses this."""
        try:
            if self._fd >= 0:
                calls.set_timer(self._fd, first, self._nanoseconds)
        except OSError as error:
            return error
        return None

    def _arm_or_raise(self, first: int) -> None:
        if error := self._arm(first):
            raise self._refused(error)

    def _refused(self, error: OSError) -> DriverError:
        return DriverError(f"timerfd: {error.strerror} (period {duration(self.period)})")


class TimerFd(Driver, EndsWait, MovesInC):
    """A driver with one channel, the tick. `read` blocks until the next sampling period and returns the number of
    missed ticks."""

    realtime = True

    def __init__(self) -> None:
        self.ticker: Ticker | None = None

    def channel(self, text: str) -> Channel:
        return Channel("tick", Direction.INPUT, 63)

    def initialize(self, channel: Channel, default: int | None) -> None:
        self.ticker = Ticker(self.period)
        self.ticker.start()

    def finalize(self, channel: Channel) -> None:
        if self.ticker is not None:
            self.ticker.close()

    def reset(self, channel: Channel, default: int | None) -> None:
        """Do nothing: a timer has no faults to clear, and its grid never moves."""

    def read(self, channel: Channel) -> int:
        if self.ticker is None:
            raise DriverError("the timer is not running")
        return self.ticker.wait()

    def in_c(self, channels: Sequence[Channel], write: bool) -> TransferInC | str:
        if native is None or self.ticker is None:
            return NOT_BUILT if native is None else "it does not run"
        return TransferInC(native.TICK, self.ticker.address(), self.ticker)

    def stop_waiting(self) -> None:
        if self.ticker is not None:
            self.ticker.stop_waiting()
