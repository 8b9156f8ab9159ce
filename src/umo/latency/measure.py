"""Measures the two loops in turns, in slices of 0.5 s, so that other load on the computer affects both."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from umo.latency import native
from umo.latency.loop import Loop
from umo.system.realtime import Refusal

SLICE = 0.5
"""s"""
BUSY = "import ctypes\nctypes.CDLL(None).prctl(1, 9)\nwhile True: pass"
"""An ordinary process that wants a whole core, and ends with its parent."""


@dataclass
class Samples:
    """The times of one loop, in us, and the periods it missed."""

    wake: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    work: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    missed: int = 0

    @property
    def total(self) -> npt.NDArray[np.float64]:
        """Waking up and working, of each period that began in time."""
        return self.wake + self.work

    def add(self, times: npt.NDArray[np.int64]) -> None:
        """One slice in ns, -1 where a tick had passed already."""
        began = times[:, 0] >= 0
        self.missed += int((~began).sum())
        self.wake = np.append(self.wake, times[began, 0] * 1e-3)
        self.work = np.append(self.work, times[began, 1] * 1e-3)


@dataclass
class Measured:
    """The results. `c` is None without a compiler."""

    period: float
    umo: Samples
    c: Samples | None
    refusals: list[Refusal]


def measure(
    period: float,
    seconds: float,
    *,
    load: bool = False,
    priority: int = 80,
    cpu: int | None = None,
    progress: Callable[[float], object] = lambda share: None,
) -> Measured:
    """Run both loops for `seconds` s each, in turns; `load` keeps every core busy beside them. Ctrl-C ends it early."""
    periods = max(20, round(SLICE / period))
    slices = max(1, round(seconds / (periods * period)))
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(os.cpu_count() or 1)] if load else []
    try:
        with closing(Loop(period, priority, cpu)) as loop, native.compiled() as program:
            found = Measured(period, Samples(), None if program is None else Samples(), loop.refusals)
            try:
                for number in range(slices):
                    found.umo.add(loop.run(periods))
                    if program is not None and found.c is not None:
                        found.c.add(native.run(program, period, periods, loop.priority, loop.cpu))
                    progress((number + 1) / slices)
            except KeyboardInterrupt:
                pass
            return found
    finally:
        for process in busy:
            process.kill()
            process.wait()
