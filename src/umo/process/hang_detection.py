"""The signs of life of the control process, as its guardian sees them: when is it hung, when kept from running?"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from time import monotonic

from umo.cycle.stage import Stage
from umo.presentation.durations import duration
from umo.process.run_state import RunState
from umo.system.processes import running_on, state, title_of

LOOK_INTERVAL = 0.02
"""Time in s between two looks of the guardian."""
MIN_SILENT_LOOKS = 3
"""The minimum number of looks without a sign of life before the control process counts as hung."""
STARVED_LIMITS = 3
"""Number of hang limits after which a control process that others kept from running is ended: nobody controls it."""
STARTING_LIMIT = 30.0
"""Timeout in s of a step of connecting, in addition to two periods."""
REPORTING_LIMIT = 5.0
"""Timeout in s for the report of the control process when the machine has been reset."""
MIN_GUARDIAN_LIMIT = 0.5
"""Minimum time in s without a sign of life before a guardian counts as lost: a busy computer delays it."""
OVERLONG = 0.04
"""Time in s that a control process may work, or wait for a processor, before its guardian does something."""


class ProcessorShare:
    """The share of one control process, since its last sign of life. It is pinned to `core`, unless that is None, until
    it is let onto every core. What is done for it is told by `say`.

    One that works for long without a sign of life gives way to those of other stations; one that is kept from running
    may run on every core. So a station that loops for ever takes nothing from the others for longer than `OVERLONG`
    and a look."""

    def __init__(self, pid: int, core: int | None, say: Callable[[str], object]) -> None:
        self._pid = pid
        self._core = core
        self._say = say
        self._cores = os.sched_getaffinity(0) | ({core} if core is not None else set())
        """The cores that it may use, but for being pinned."""
        self._file: int | None = None
        with suppress(OSError):
            self._file = os.open(f"/proc/{pid}/schedstat", os.O_RDONLY)
        self._last: tuple[float, float, float] | None = None
        self._priority = 0
        """Priority before it gave way; 0 if it has not."""
        self._ran = self._waited = 0.0
        self._occupant = ""
        """The process that had its core, and which that was, in words; empty if that is not known."""

    @property
    def kept_waiting(self) -> float:
        """s for which others had the processor, as far as that is certain: on a core of its own somebody must be known
        who had it. 0 for a control process that had worked for long itself."""
        certain = not self._priority and self._core is None
        return self._waited if certain else 0.0

    @property
    def by_whom(self) -> str:
        """Who had the processor, in words."""
        return self._occupant or "other processes had the processors"

    def begin(self) -> None:
        """There was a sign of life: all is as before."""
        self._last, self._ran, self._waited, self._occupant = None, 0.0, 0.0, ""
        if self._priority:
            with suppress(OSError):
                os.sched_setscheduler(self._pid, os.SCHED_FIFO, os.sched_param(self._priority))
            self._priority = 0

    def look(self) -> None:
        """There was none since the last look."""
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
        """Now, the time on a processor and the time waiting for one, in s (sched-stats in the kernel's documents)."""
        if self._file is None:
            return None
        with suppress(OSError, ValueError):
            ran, waited, _ = os.pread(self._file, 64, 0).split()
            return monotonic(), int(ran) * 1e-9, int(waited) * 1e-9
        return None

    def _give_way(self) -> None:
        """From now on it is an ordinary process: the devices, too, may be served by such ones of this computer."""
        with suppress(OSError):
            priority = os.sched_getparam(self._pid).sched_priority
            if priority:
                os.sched_setscheduler(self._pid, os.SCHED_OTHER, os.sched_param(0))
                self._priority = priority

    def _find_room(self) -> None:
        """Another process has its core: let it run on every core."""
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


def guardian_limit(hang: float) -> float:
    """Limit in s for a guardian's own signs of life. `hang`: the limit for those of its control process."""
    return max(hang, MIN_GUARDIAN_LIMIT)


class HangDetector:
    """How long the control process has given no sign of life. `hang`: limit in s while it runs; `period` in s. The
    time for which other processes kept it from running is not counted, up to `STARVED_LIMITS` times the limit."""

    def __init__(self, run_state: RunState, share: ProcessorShare, hang: float, period: float) -> None:
        self._run_state = run_state
        self._share = share
        self._hang = hang
        self._period = period
        self._beat = self._looks = 0

    def look(self) -> str:
        """One look, every `LOOK_INTERVAL` s: empty, or in words that the control process hangs."""
        run_state, share = self._run_state, self._share
        if self._beat != run_state.last_beat:
            self._beat, self._looks = run_state.last_beat, 0
            share.begin()
            run_state.excuse(0.0)
            return ""
        self._looks += 1
        share.look()
        run_state.excuse(share.kept_waiting)
        silence, limit = run_state.silence, self.limit
        # several looks: if the whole computer stood still, the control process gets time to report that itself
        if silence <= limit or self._looks < max(MIN_SILENT_LOOKS, limit / LOOK_INTERVAL):
            return ""
        waited = share.kept_waiting
        if silence - waited <= limit and silence <= STARVED_LIMITS * limit:
            return ""
        if waited > silence / 2:
            return f"was kept from running for {waited:.2f} s while {run_state.stage}: {share.by_whom}"
        return f"hung: no sign of life for {duration(limit)} while {run_state.stage}"

    @property
    def limit(self) -> float:
        """The limit in s in the present stage of the run."""
        if self._run_state.stage is Stage.STARTING:
            return STARTING_LIMIT + 2 * self._period
        return REPORTING_LIMIT if self._run_state.stage is Stage.ENDED else self._hang
