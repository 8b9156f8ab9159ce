"""The loop in C, compiled on the spot."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

SOURCE = Path(__file__).parent / "loop.c"
COMPILERS = ("cc", "gcc", "clang")


def compiler() -> str | None:
    """The C compiler of this computer: $CC, cc, gcc or clang; None without one."""
    return next(filter(None, map(shutil.which, filter(None, (os.environ.get("CC"), *COMPILERS)))), None)


@contextmanager
def compiled() -> Iterator[Path | None]:
    """The program for as long as the block lasts; None without a compiler, or where it fails."""
    found = compiler()
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "loop"
        if found is None:
            yield None
            return
        compiling = subprocess.run([found, "-O2", "-o", str(program), str(SOURCE)], capture_output=True, check=False)
        yield program if compiling.returncode == 0 else None


class Slice(NamedTuple):
    """The times of some periods of a loop, in ns."""

    times: npt.NDArray[np.int64]
    """Shape (periods, 2): late in waking up, working; -1 for ticks that passed meanwhile."""
    processor: int
    """Processor time."""
    elapsed: int

    @classmethod
    def of(cls, data: bytes) -> Slice:
        """A slice as the loops send it: processor time and time are the last row."""
        rows = np.frombuffer(data, np.int64).reshape(-1, 2)
        return cls(rows[:-1], int(rows[-1, 0]), int(rows[-1, 1]))


def run(program: Path, period: float, periods: int, priority: int, cpu: int | None, busy_wait: float = 0.0) -> Slice:
    """Run the program once, with so many periods. It stops to sleep `busy_wait` s before each tick."""
    words = [round(period * 1e9), periods, priority, -1 if cpu is None else cpu, round(busy_wait * 1e9)]
    return Slice.of(subprocess.run([str(program), *map(str, words)], capture_output=True, check=True).stdout)
