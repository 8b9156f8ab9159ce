"""The loop in C, compiled when it is measured."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from umo.generate.c_compiler import COMPILE_TIMEOUT, compiler

SOURCE = Path(__file__).parent / "loop.c"
SLICE_MARGIN = 30.0
"""The time in s that a slice may take in addition to ten times the duration of its periods."""


@contextmanager
def compiled() -> Iterator[Path | None]:
    """Return a context with the compiled program, which is deleted at its end; None without a compiler, or if compiling
    fails."""
    found = compiler()
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "loop"
        if found is None:
            yield None
            return
        words = [found, "-O2", "-o", str(program), str(SOURCE)]
        failed = True
        with suppress(OSError, subprocess.TimeoutExpired):
            failed = subprocess.run(words, capture_output=True, check=False, timeout=COMPILE_TIMEOUT).returncode != 0
        yield None if failed else program


class Slice(NamedTuple):
    """The times of some periods of a loop, in ns."""

    times: npt.NDArray[np.int64]
    """An array of shape (periods, 2) with the delay of waking up and the duration of the work. Both are -1 for a tick
    that was missed."""
    processor: int
    """The processor time in ns."""
    elapsed: int

    @classmethod
    def of(cls, data: bytes) -> Slice:
        """Make a slice from the rows that the loops send; the last row has the processor time and the elapsed time."""
        rows = np.frombuffer(data, np.int64).reshape(-1, 2)
        return cls(rows[:-1], int(rows[-1, 0]), int(rows[-1, 1]))


def run(program: Path, period: float, periods: int, priority: int, cpu: int | None, busy_wait: float = 0.0) -> Slice:
    """Run the program once, with this number of periods. The program ends its sleep `busy_wait` s before each tick."""
    words = [round(period * 1e9), periods, priority, -1 if cpu is None else cpu, round(busy_wait * 1e9)]
    limit = time_limit(period, periods)
    done = subprocess.run([str(program), *map(str, words)], capture_output=True, check=True, timeout=limit)
    return Slice.of(done.stdout)


def time_limit(period: float, periods: int) -> float:
    """Return the timeout in s for a slice of this number of periods. It has a margin, because other processes may take
    the processor or stop the loop."""
    return SLICE_MARGIN + 10 * period * periods
