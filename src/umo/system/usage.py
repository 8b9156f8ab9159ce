"""Counters of the interruptions of this thread by the operating system and the interpreter."""

from __future__ import annotations

import gc
import os
from time import monotonic_ns

try:
    import resource
except ImportError:  # not on this platform
    resource = None  # type: ignore[assignment]

SCHEDSTAT = "/proc/thread-self/schedstat"
"""Time on a processor and time waiting for one, in ns (Documentation/scheduler/sched-stats in Linux)."""


class Usage:
    """The counts since the object was made: the nine numbers of `layout.USAGE`. Numbers that a platform does not
    provide remain 0."""

    def __init__(self) -> None:
        self._thread = getattr(resource, "RUSAGE_THREAD", None)
        try:
            self._file = os.open(SCHEDSTAT, os.O_RDONLY)
        except OSError:
            self._file = -1
        self.collections = 0
        """The number of runs of the garbage collector so far."""
        self._collecting = 0
        self._began = 0
        gc.callbacks.append(self._collected)

    def close(self) -> None:
        gc.callbacks.remove(self._collected)
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def read(self) -> tuple[int, ...]:
        """Return the counts so far. This takes about 2 us."""
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
