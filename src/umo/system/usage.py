"""What a frame tells of the computer: counters of what the operating system and the interpreter have done to this
thread so far; UTC of this computer against its monotonic clock, and how far off it may be."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from functools import cache
from time import monotonic_ns, time_ns
from typing import Any

try:
    import resource
except ImportError:  # not on this platform
    resource = None  # type: ignore[assignment]

SCHEDSTAT = "/proc/thread-self/schedstat"
"""Time on a processor and time waiting for one, in ns (Documentation/scheduler/sched-stats in Linux)."""
UNKNOWN = -1
"""ns: the error of a clock that is not synchronised, or of a platform that does not tell it."""
UNSYNCHRONISED = 0x40
"""STA_UNSYNC of `status` (adjtimex(2))."""


class Usage:
    """Counts since it was made: the nine numbers of `layout.USAGE`; what a platform does not tell stays 0."""

    def __init__(self) -> None:
        self._thread = getattr(resource, "RUSAGE_THREAD", None)
        try:
            self._file = os.open(SCHEDSTAT, os.O_RDONLY)
        except OSError:
            self._file = -1
        self.collections = 0
        """Runs of the garbage collector so far."""
        self._collecting = 0
        self._began = 0
        gc.callbacks.append(self._collected)

    def close(self) -> None:
        gc.callbacks.remove(self._collected)
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def read(self) -> tuple[int, ...]:
        """The counts so far, about 2 us."""
        minor = major = voluntary = involuntary = kernel = running = waiting = 0
        if self._thread is not None:
            used = resource.getrusage(self._thread)
            kernel, minor, major, voluntary, involuntary = int(used[1] * 1e9), used[6], used[7], used[14], used[15]
        if self._file >= 0:
            ran, waited, _ = os.pread(self._file, 64, 0).split()
            running, waiting = int(ran), int(waited)
        return minor, major, voluntary, involuntary, kernel, running, waiting, self.collections, self._collecting

    def _collected(self, phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            self._began = monotonic_ns()
        else:
            self.collections += 1
            self._collecting += monotonic_ns() - self._began


class _Timex(ctypes.Structure):
    """The struct timex of adjtimex(2), up to `status`; the rest is room."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


def utc() -> tuple[int, int]:
    """ns to be added to CLOCK_MONOTONIC for UTC since 1970, and its greatest error in ns; `UNKNOWN`: not told."""
    before, now, after = monotonic_ns(), time_ns(), monotonic_ns()
    error = _error()
    return now - (before + after) // 2, error if error == UNKNOWN else error + (after - before + 1) // 2


def _error() -> int:
    adjtimex, asked = _adjtimex(), _Timex()
    if adjtimex is None or adjtimex(ctypes.byref(asked)) < 0 or asked.status & UNSYNCHRONISED:
        return UNKNOWN
    return int(asked.maxerror) * 1000


@cache
def _adjtimex() -> Any:
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "adjtimex", None)
