"""This tree against another checkout, row by row: `python -m bench --against DIR`.

A row is measured in pairs of blocks, one of each tree, in turns. The figure is the median of the paired ratios with its
95 % interval (order statistics of the binomial distribution). A limit counts as missed only if the whole interval lies
beyond it. Both sides run in processes of their own, which are started anew several times: how the memory of a process
happens to lie is worth some per cent.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import comb
from pathlib import Path
from statistics import median
from types import TracebackType

from rich.console import Console

from bench.report import Doing

HERE = Path(__file__).resolve().parents[1]
STARTS = 6
"""Times that the processes are started."""
LIMIT = 1.03
"""Ratio from which on a row is worse (design, 13.18)."""


@dataclass
class Row:
    """The paired blocks of one row: this tree's figure and the other's."""

    name: str
    pairs: list[tuple[float, float]] = field(default_factory=list)

    @property
    def ratios(self) -> list[float]:
        return sorted(here / there for here, there in self.pairs)

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of the median ratio at 95 % confidence; the least and the greatest ratio below 6 pairs."""
        ratios = self.ratios
        rank = lower_rank(len(ratios))
        return ratios[rank], ratios[len(ratios) - 1 - rank]

    @property
    def verdict(self) -> str:
        low, high = self.interval
        return "worse" if low > LIMIT else "better" if high < 1 else "not worse" if high <= LIMIT else "not told apart"

    def __str__(self) -> str:
        here, there = (median(side) for side in zip(*self.pairs, strict=True))
        low, high = self.interval
        ratio = f"{median(self.ratios):.3f} ({low:.3f} to {high:.3f})"
        return f"{self.name:<66} {here:>10.4g} {there:>10.4g}   {ratio:<26} {self.verdict}"


def lower_rank(count: int) -> int:
    """Index of the order statistic that bounds the median of `count` values from below at 95 % confidence."""
    rank, outside = 0, 2 / 2**count
    while outside + 2 * comb(count, rank + 1) / 2**count <= 0.05:
        rank += 1
        outside += 2 * comb(count, rank) / 2**count
    return rank


class Side:
    """A process that measures blocks of one tree."""

    def __init__(self, tree: Path) -> None:
        python = tree / ".venv" / "bin" / "python"
        if not python.exists():
            raise SystemExit(f"{tree} has no .venv: run `make .venv/installed` there")
        environment = os.environ | {"PYTHONPATH": str(tree)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # both sides import compiled files
        self._process = subprocess.Popen(
            [str(python), "-P", str(HERE / "bench" / "block.py")],
            cwd=tree,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def rows(self) -> list[str]:
        names: list[str] = json.loads(self._line())
        return names

    def measure(self, row: str) -> float:
        assert self._process.stdin is not None
        print(json.dumps(row), file=self._process.stdin, flush=True)
        return float(self._line())

    def _line(self) -> str:
        assert self._process.stdout is not None
        if not (line := self._process.stdout.readline()):
            raise SystemExit(f"a process that measures ended with status {self._process.wait()}")
        return line

    def __enter__(self) -> Side:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()


@contextmanager
def _sides(other: Path) -> Iterator[tuple[Side, Side]]:
    with Side(HERE) as here, Side(other) as there:
        yield here, there


def measure(other: Path, only: str, pairs: int, doing: Doing) -> list[Row]:
    """The rows with `only` in their names that both trees have."""
    found: dict[str, Row] = {}
    starts = min(STARTS, pairs)
    for start in range(starts):
        count = pairs * (start + 1) // starts - pairs * start // starts
        with _sides(other) as (here, there):
            there_too = set(there.rows())
            for name in (name for name in here.rows() if only in name and name in there_too):
                doing(f"{name} ({start + 1} of {starts} starts)")
                found.setdefault(name, Row(name)).pairs.extend(_pairs(here, there, name, count))
    return list(found.values())


def _pairs(here: Side, there: Side, name: str, count: int) -> Iterator[tuple[float, float]]:
    """In turns; each side is first in every second pair."""
    for number in range(count):
        if number % 2:
            second = there.measure(name)
            yield here.measure(name), second
        else:
            yield here.measure(name), there.measure(name)


def show(rows: Sequence[Row]) -> int:
    """Print the rows; status 1 if one is worse."""
    print(f"{'row':<66} {'here':>10} {'there':>10}   {'ratio (95 %)':<26} verdict")
    for row in rows:
        print(row)
    return 1 if any(row.verdict == "worse" for row in rows) else 0


def run(console: Console, other: Path, only: str, pairs: int) -> int:
    with console.status("starting both sides") as status:
        rows = measure(other.resolve(), only, pairs, status.update)
    return show(rows)
