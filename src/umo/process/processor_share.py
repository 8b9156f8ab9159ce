"""The share of a processor that a control process has, which its guardian measures and enforces.

A control process that works for a long time without a heartbeat loses its priority over the control processes of other
stations. A control process that cannot run may use every core. So a station with an endless loop delays other stations
for at most `OVERLONG` plus the time between two looks.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress

from umo.system import calls
from umo.system.processes import ProcessHandle, running_on, state, title_of

OVERLONG = 0.04
"""Time in s that a control process may work, or wait for a processor, before its guardian reacts."""


class ProcessorShare:
    """The share of one control process since its last heartbeat. Unless `core` is None, the process is pinned to this
    core until it may use every core. `say` prints the reactions."""

    def __init__(self, process: ProcessHandle, core: int | None, say: Callable[[str], object]) -> None:
        self._process, self._pid = process, process.pid
        self._core = core
        self._say = say
        self._cores = os.sched_getaffinity(0) | ({core} if core is not None else set())
        """The cores that the process may use when it is not pinned."""
        self._file: int | None = None
        with suppress(OSError):
            self._file = calls.open(f"/proc/{process.pid}/schedstat", os.O_RDONLY)
        self._last: tuple[float, float, float] | None = None
        self._priority = 0
        """The priority of the process before it was lowered; 0 if it was not lowered."""
        self._ran = self._waited = 0.0
        self._occupant = ""
        """The process that had the core, and its name as text; empty if it is not known."""

    @property
    def kept_waiting(self) -> float:
        """The time in s for which other processes certainly had the processor. On a reserved core, the other process
        must be known. The time is 0 for a control process that had itself worked for a long time."""
        certain = not self._priority and self._core is None
        return self._waited if certain else 0.0

    @property
    def by_whom(self) -> str:
        """The processes that had the processor, as text."""
        return self._occupant or "other processes had the processors"

    def begin(self) -> None:
        """Start again after a heartbeat."""
        self._last, self._ran, self._waited, self._occupant = None, 0.0, 0.0, ""
        if self._priority and not self._process.ended:
            with suppress(OSError):
                os.sched_setscheduler(self._pid, os.SCHED_FIFO, os.sched_param(self._priority))
            self._priority = 0

    def look(self) -> None:
        """Check the share, because there was no heartbeat since the last look."""
        if self._process.ended:  # its number may be another's
            return
        now = self._times()
        if self._last is not None and now is not None:
            time, ran, waited = (new - old for new, old in zip(now, self._last, strict=True))
            idle = max(0.0, time - ran)
            self._ran += ran
            self._waited += idle if state(self._pid) == "R" else min(idle, waited)
        self._last = now
        if self._ran > OVERLONG:
            self._give_way()
        elif self._waited > OVERLONG and self._core is not None:
            self._find_room()

    def _times(self) -> tuple[float, float, float] | None:
        """Return three times in s: now, the time on a processor, and the time waiting for a processor (sched-stats in
        the kernel's documents). None if they are not available."""
        if self._file is None:
            return None
        with suppress(OSError, ValueError):
            ran, waited, _ = os.pread(self._file, 64, 0).split()
            return calls.now(), int(ran) * 1e-9, int(waited) * 1e-9
        return None

    def _give_way(self) -> None:
        """Become an ordinary process, so that processes which serve the devices on this computer can run."""
        with suppress(OSError):
            priority = os.sched_getparam(self._pid).sched_priority
            if priority:
                os.sched_setscheduler(self._pid, os.SCHED_OTHER, os.sched_param(0))
                self._priority = priority

    def _find_room(self) -> None:
        """Let the control process run on every core if another process has its core."""
        with suppress(OSError):
            other = running_on(os.sched_getaffinity(self._pid), {self._pid, os.getpid()})
            if other is None:
                return
            os.sched_setaffinity(self._pid, self._cores)
            name = title_of(other)
            self._say(
                f"the control process did not get core {self._core} for {self._waited * 1e3:.0f} ms: {name} had it; "
                "from now on it runs on every core"
            )
            self._occupant, self._core = f"{name} had core {self._core}", None
