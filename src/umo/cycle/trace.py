"""What a run leaves behind: the statistics of its periods and a trace, in bounded memory however long it runs."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.frame import Frame
from umo.objects import Atomic, Binary, Digital

ROWS = 100_000


class Statistics:
    """Counts every period and keeps the execution times of the last `capacity` ones, in us."""

    def __init__(self, capacity: int = 1_000_000) -> None:
        self._times = np.empty(capacity, np.float32)
        self.periods = 0
        self.missed = 0
        """Ticks that had passed when the timer was read: the periods that came too late."""

    def __call__(self, frame: Frame) -> None:
        self._times[self.periods % len(self._times)] = frame.execution * 1e6
        self.periods += 1
        self.missed += frame.missed

    def percentile(self, q: float) -> float | None:
        """Execution time in us; None before the first period."""
        kept = self._times[: min(self.periods, len(self._times))]
        return float(np.percentile(kept, q)) if len(kept) else None


class Trace:
    """A row a period: time in s, missed, execution time in us, then each object's value.

    When the rows are full every second one is dropped and from then on only every second period kept, and so
    on: the whole run stays in view. `note` may give a label for what the machine was doing.
    """

    def __init__(self, rows: int = ROWS, note: Callable[[], str] | None = None) -> None:
        self._capacity = rows
        self._rows: npt.NDArray[np.float64] | None = None
        self._used = 0
        self._seen = 0
        self._note = note
        self.items: list[Atomic] = []
        self.stride = 1
        """Every how many periods a row was kept."""
        self.notes: list[tuple[float, str]] = []
        """When each label began, in s."""

    def __call__(self, frame: Frame) -> None:
        if self._rows is None:
            self.items = list(frame.items)
            self._rows = np.empty((self._capacity, 3 + len(self.items)))
        if self._note is not None and (note := self._note()) != (self.notes[-1][1] if self.notes else None):
            self.notes.append((frame.time, note))
        self._seen += 1
        if self._used == self._capacity:
            self._thin(self._rows)
        if (self._seen - 1) % self.stride:
            self._rows[self._used - 1, 1] += frame.missed  # none is lost with the rows that are not kept
            return
        row = self._rows[self._used]
        row[0], row[1], row[2] = frame.time, frame.missed, frame.execution * 1e6
        row[3:] = frame.values
        self._used += 1

    def _thin(self, rows: npt.NDArray[np.float64]) -> None:
        kept = rows[: self._used : 2].copy()
        dropped = rows[1 : self._used : 2, 1]
        kept[: len(dropped), 1] += dropped
        self._used = len(kept)
        rows[: self._used] = kept
        self.stride *= 2

    @property
    def rows(self) -> npt.NDArray[np.float64]:
        """The rows kept, of shape (n, 3 + objects)."""
        return np.empty((0, 3)) if self._rows is None else self._rows[: self._used]

    @property
    def columns(self) -> list[str]:
        """`time_s`, `missed`, `execution_us`, then a path with its unit, or for a binary object with its 1 state."""
        return ["time_s", "missed", "execution_us", *map(_column, self.items)]

    def column(self, item: Atomic) -> npt.NDArray[np.float64]:
        return self.rows[:, 3 + self.items.index(item)]

    def save(self, path: Path) -> None:
        """As CSV; OSError when the disk is full."""
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            writer.writerows(_texts(self.rows))


def _column(item: Atomic) -> str:
    if isinstance(item, Digital):
        return f"{item.path}[{item.units}]"
    assert isinstance(item, Binary)
    return f"{item.path}[{item.one}=1]"


def _texts(rows: npt.NDArray[np.float64]) -> Iterator[list[Any]]:
    for row in rows:
        yield [f"{value:.10g}" for value in row]
