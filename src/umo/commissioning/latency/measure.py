"""The measurement of the two loops in alternating slices of 0.5 s, so that other load on the computer affects both."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from umo.commissioning.latency import native
from umo.commissioning.latency.loop import END_TIMEOUT, Loop
from umo.system import realtime
from umo.system.realtime import Refusal

SLICE_TIME = 0.5
"""The duration of a slice in s."""
BUSY_PROGRAM = "import ctypes\nctypes.CDLL(None).prctl(1, 9)\nwhile True: pass"
"""The program of an ordinary process that uses a whole core and ends with its parent."""


@dataclass
class Samples:
    """The times of one loop in us, and the number of periods that it missed."""

    wake: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    work: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    missed: int = 0
    processor: float = 0.0
    """The processor time in ns."""
    elapsed: float = 0.0
    """The elapsed time in ns."""

    @property
    def busy(self) -> float:
        """The share of a processor that the loop used."""
        return self.processor / self.elapsed if self.elapsed else 0.0

    @property
    def total(self) -> npt.NDArray[np.float64]:
        """The wake-up time plus the work time of each period that began in time."""
        return self.wake + self.work

    def add(self, found: native.Slice) -> None:
        times = found.times
        self.processor, self.elapsed = self.processor + found.processor, self.elapsed + found.elapsed
        began = times[:, 0] >= 0
        self.missed += int((~began).sum())
        self.wake = np.append(self.wake, times[began, 0] * 1e-3)
        self.work = np.append(self.work, times[began, 1] * 1e-3)


@dataclass
class Measured:
    """The results for umo's loop and for the C loop, both sleeping until the tick and waiting busily."""

    period: float
    busy_wait: float
    """Time in s before the tick from which a loop waits busily."""
    refusals: list[Refusal]
    granted: bool = False
    """True if SCHED_FIFO and a core were granted."""
    umo: Samples = field(default_factory=Samples)
    umo_busy: Samples = field(default_factory=Samples)
    c: Samples | None = None
    """The samples of the loop in C; None without a compiler."""
    c_busy: Samples | None = None

    @property
    def loops(self) -> dict[str, Samples]:
        """The loops that were measured, by name."""
        found = {"umo": self.umo, "umo, busy waiting": self.umo_busy, "C": self.c, "C, busy waiting": self.c_busy}
        return {name: samples for name, samples in found.items() if samples is not None}

    @property
    def by_itself(self) -> Samples:
        """The samples of that variant of umo's loop (sleeping or waiting busily) that `umo run` uses on this computer
        by default."""
        return self.umo_busy if self.granted else self.umo


def measure(
    period: float, seconds: float, *, load: bool = False, progress: Callable[[float], object] = lambda share: None
) -> Measured:
    """Run all loops for `seconds` s each, alternating; `load` keeps every core busy at the same time. Ctrl-C ends it
    early."""
    periods = max(20, round(SLICE_TIME / period))
    slices = max(1, round(seconds / (periods * period)))
    busy = [subprocess.Popen([sys.executable, "-c", BUSY_PROGRAM]) for _ in range(os.cpu_count() or 1)] if load else []
    try:
        with closing(Loop(period)) as loop, native.compiled() as program:
            found = Measured(period, realtime.busy_wait_for(period), loop.refusals, loop.granted)
            if program is not None:
                found.c, found.c_busy = Samples(), Samples()
            try:
                for number in range(slices):
                    _slice(found, loop, program, periods)
                    progress((number + 1) / slices)
            except KeyboardInterrupt:
                pass
            return found
    finally:
        for process in busy:
            process.kill()
        for process in busy:
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_TIMEOUT)


def _slice(found: Measured, loop: Loop, program: Path | None, periods: int) -> None:
    found.umo.add(loop.run(periods))
    found.umo_busy.add(loop.run(periods, found.busy_wait))
    if program is not None and found.c is not None and found.c_busy is not None:
        found.c.add(native.run(program, found.period, periods, loop.priority, loop.cpu))
        found.c_busy.add(native.run(program, found.period, periods, loop.priority, loop.cpu, found.busy_wait))
