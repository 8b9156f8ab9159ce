"""Memory shared by guardian and control process: a lock that reports the death of its owner, and signs of life.

The lock is a process-shared, robust pthread mutex: the kernel hands it on with EOWNERDEAD while the dead process is
still being taken apart, 0.2 ms after a SIGKILL, where waiting for the exit took up to 30 ms with locked memory
(POSIX.1-2017, pthread_mutexattr_setrobust). Nothing here needs a descriptor, so nothing that the control process does
with its own can spoil it.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import time

from umo.cycle.stage import Stage

MUTEX = 64
"""Bytes set aside for a pthread_mutex_t: 40 on x86-64, 48 on AArch64."""
STAGE, BEAT, ASKED, WATCH, LENGTH = range(5)
CELLS = 8
REPORT = MUTEX + 8 * CELLS
LARGEST = 1 << 16
"""Bytes of a report."""
CLOCK_MONOTONIC = 1
PROCESS_SHARED = ROBUST = 1
CLOCK = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", 0))
"""Goes on while the computer is suspended."""


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def clock() -> int:
    """ns on the clock of the signs of life."""
    return time.clock_gettime_ns(CLOCK)


class Life:
    """Made by the guardian before it forks."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._memory = mmap.mmap(-1, REPORT + LARGEST)  # anonymous and shared
        self._mutex = ctypes.c_char.from_buffer(self._memory)
        self._cells = memoryview(self._memory)[MUTEX:REPORT].cast("q")
        attributes = ctypes.create_string_buffer(64)
        self._libc.pthread_mutexattr_init(attributes)
        self._libc.pthread_mutexattr_setpshared(attributes, PROCESS_SHARED)
        self._libc.pthread_mutexattr_setrobust(attributes, ROBUST)
        self._libc.pthread_mutex_init(ctypes.byref(self._mutex), attributes)
        self.watch()
        self.enter(Stage.STARTING)

    # The control process -------------------------------------------------------------------------------

    def hold(self) -> None:
        """Take the lock: from now on the guardian detects the death of this thread."""
        self._libc.pthread_mutex_lock(ctypes.byref(self._mutex))

    def enter(self, stage: Stage) -> None:
        self._cells[STAGE] = stage
        self.beat()

    def beat(self) -> float:
        """A sign of life, in every period while running; s since the one before."""
        cells, now = self._cells, time.clock_gettime_ns(CLOCK)
        before = cells[BEAT]
        cells[BEAT] = now
        return (now - before) * 1e-9

    @property
    def unwatched(self) -> float:
        """Seconds since the guardian last looked."""
        return (clock() - self._cells[WATCH]) * 1e-9

    @property
    def asked(self) -> int:
        """The signal that the guardian asked to stop with; 0 for none."""
        return int(self._cells[ASKED])

    def report(self, text: bytes) -> None:
        """Write the report of the end. A report that is too long is dropped; the guardian then treats it as invalid."""
        self._memory[REPORT : REPORT + min(len(text), LARGEST)] = text[:LARGEST]
        self._cells[LENGTH] = len(text)

    # The guardian --------------------------------------------------------------------------------------

    def watch(self) -> None:
        """The guardian's own sign of life."""
        self._cells[WATCH] = clock()

    def ask(self, number: int) -> None:
        """Ask the control process to stop, like this signal does."""
        self._cells[ASKED] = number

    @property
    def stage(self) -> Stage:
        try:
            return Stage(self._cells[STAGE])
        except ValueError:  # the control process may write anything
            return Stage.RUNNING

    @property
    def last_beat(self) -> int:
        """Time of the last sign of life, in ns on `clock`."""
        return int(self._cells[BEAT])

    @property
    def silence(self) -> float:
        """Seconds since the last sign of life."""
        return (clock() - self._cells[BEAT]) * 1e-9

    def reported(self) -> bytes:
        """What the control process said at its end."""
        return bytes(self._memory[REPORT : REPORT + min(max(self._cells[LENGTH], 0), LARGEST)])

    def gone(self, within: float) -> bool:
        """Wait up to `within` s for the holder of the lock to die; whether it did."""
        answer = self._lock_until(within)
        if answer == errno.ETIMEDOUT:
            return False
        if answer == errno.EOWNERDEAD:
            self._libc.pthread_mutex_consistent(ctypes.byref(self._mutex))
        if answer in (0, errno.EOWNERDEAD):
            self._libc.pthread_mutex_unlock(ctypes.byref(self._mutex))
            return True
        raise OSError(answer, "the lock of the control process failed")

    def _lock_until(self, within: float) -> int:
        """On the monotonic clock, which nobody sets (glibc from 2.30 on); else on the wall clock."""
        mutex, lock = ctypes.byref(self._mutex), getattr(self._libc, "pthread_mutex_clocklock", None)
        until = (time.time() if lock is None else time.monotonic()) + within
        limit = ctypes.byref(_Timespec(int(until), int(until % 1 * 1e9)))
        if lock is None:
            return int(self._libc.pthread_mutex_timedlock(mutex, limit))
        return int(lock(mutex, CLOCK_MONOTONIC, limit))
