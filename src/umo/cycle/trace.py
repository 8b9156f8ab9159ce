"""Statistics and trace of a run. Their memory is limited, however long the run is."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.frame import Frame, Signal
from umo.objects import Atomic, Quality
from umo.objects.description import described
from umo.objects.presentation.described import column_heading
from umo.objects.quality import NOT_GOOD, told_not_good

MAX_ROWS = 100_000
"""Largest number of rows of a trace."""
MAX_BYTES = 32_000_000
"""The largest size of a trace in bytes, including the copy that is made while the trace grows or is thinned."""
MAX_NOTES = 4096
"""The largest number of texts of the progress that are kept. If there are more texts, every second one is dropped."""
HALVINGS = 6
"""Number of times that the memory of a trace is doubled; it begins with a 64th of its rows."""


class Statistics:
    """Statistics that count every period and keep the execution times in us of the last `capacity` periods."""

    def __init__(self, capacity: int = 1_000_000) -> None:
        self._times = np.empty(capacity, np.float32)
        self._written: Any = self._times.data  # a memoryview: quicker than numpy's items
        self.periods = 0
        self.missed = 0
        """Number of ticks that had passed when the timer was read: the periods that were missed."""

    def __call__(self, frame: Frame) -> None:
        self._written[self.periods % len(self._written)] = frame.execution * 1e6
        self.periods += 1
        self.missed += frame.missed

    def percentile(self, q: float) -> float | None:
        """Return a percentile of the execution time in us; None before the first period."""
        kept = self._times[: min(self.periods, len(self._times))]
        return float(np.percentile(kept, q)) if len(kept) else None


class Trace:
    """The trace of a run, with a row per period: time in s, missed, execution time in us, then the values of the
    objects and of the signals. NaN stands for a BAD value, and for a signal without a value. `qualities` has a row for
    each of these rows. When the rows are full, every second row is dropped, and from then on only every second period
    is kept. This is repeated, so that the trace covers the whole run. The number of rows is the requested one, or
    smaller if the rows would take more than `MAX_BYTES` bytes.
    """

    def __init__(self, rows: int = MAX_ROWS) -> None:
        self._capacity = rows
        self._rows: npt.NDArray[np.float64] | None = None
        self._qualities: npt.NDArray[np.uint8] = np.empty((0, 0), np.uint8)
        self._used = 0
        self._periods = 0
        self.items: list[Atomic] = []
        self.signals: Sequence[Signal] = ()
        self.stride = 1
        """The number of periods for which one row is kept."""
        self.notes: list[tuple[float, str]] = []
        """The texts of the progress, each with the time in s at which it began."""

    def __call__(self, frame: Frame) -> None:
        rows = self._begin(frame) if self._rows is None else self._rows
        if (text := frame.progress.text) != (self.notes[-1][1] if self.notes else ""):
            self.notes.append((frame.time, text))
            if len(self.notes) > MAX_NOTES:
                del self.notes[1:-1:2]
        self._periods += 1
        if self._used == len(rows):
            rows = self._grow(rows) if self._used < self._capacity else self._thin(rows)
        if (self._periods - 1) % self.stride:
            rows[self._used - 1, 1] += frame.missed  # none is lost with the rows that are not kept
            return
        row = rows[self._used]
        row[0], row[1], row[2] = frame.time, frame.missed, frame.execution * 1e6
        values = row[3 : 3 + len(self.items)]
        values[:] = frame.values
        self._qualities[self._used] = frame.quality
        if Quality.BAD in frame.quality.tobytes():  # quicker than a comparison of arrays
            values[self._qualities[self._used] == Quality.BAD] = np.nan
        row[3 + len(self.items) :] = frame.signal_values
        self._used += 1

    def _begin(self, frame: Frame) -> npt.NDArray[np.float64]:
        self.items, self.signals = list(frame.items), frame.signals
        columns = 3 + len(self.items) + len(self.signals)
        affordable = MAX_BYTES * 2 // 3 // (columns * 8 + len(self.items))  # half as many again are the copy
        self._capacity = max(2, min(self._capacity, affordable))
        return self._take(max(1, self._capacity >> HALVINGS), columns)

    def _take(self, count: int, columns: int) -> npt.NDArray[np.float64]:
        """Use memory for `count` rows from now on, with the rows kept so far."""
        before, qualities = self.rows, self.qualities
        self._rows = np.empty((count, columns))
        self._qualities = np.empty((count, len(self.items)), np.uint8)
        if self._used:
            self._rows[: self._used], self._qualities[: self._used] = before, qualities
        return self._rows

    def _grow(self, rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Move the rows to memory of at least twice the size, within the capacity."""
        halvings = HALVINGS
        while self._capacity >> halvings <= len(rows):
            halvings -= 1
        return self._take(self._capacity >> halvings, rows.shape[1])

    def _thin(self, rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        kept = rows[: self._used : 2].copy()
        dropped = rows[1 : self._used : 2, 1]
        kept[: len(dropped), 1] += dropped
        qualities = self._qualities[: self._used : 2].copy()
        self._used = len(kept)
        rows[: self._used], self._qualities[: self._used] = kept, qualities
        self.stride *= 2
        return rows

    @property
    def full(self) -> bool:
        """True if every second row would be dropped to add the next one."""
        return self._used == self._capacity

    def clear(self) -> None:
        """Delete the rows and notes so far. The next period is kept."""
        self._used = self._periods = 0
        self.stride = 1
        self.notes.clear()

    @property
    def rows(self) -> npt.NDArray[np.float64]:
        """The rows kept, of shape (n, 3 + objects + signals)."""
        return np.empty((0, 3)) if self._rows is None else self._rows[: self._used]

    @property
    def qualities(self) -> npt.NDArray[np.uint8]:
        """The qualities of the rows kept, as numbers of `Quality`, of shape (n, objects)."""
        return self._qualities[: self._used]

    @property
    def columns(self) -> list[str]:
        """The names of the columns: `time_s`, `missed`, `execution_us`, then the path of each object with its unit, or
        with the names of its states and their numbers (for a binary object, with its state 1); then the signals in the
        same form. In a file `not_good` is the last one."""
        signals = [column_heading(signal.path, signal.unit, signal.states) for signal in self.signals]
        return ["time_s", "missed", "execution_us", *(described(item).heading for item in self.items), *signals]

    def place(self, shown: Atomic | Signal) -> int:
        """Return the column of an object or a signal in `rows`."""
        if isinstance(shown, Signal):
            return 3 + len(self.items) + self.signals.index(shown)
        return 3 + self.items.index(shown)

    def save(self, path: Path) -> None:
        """Write the trace as CSV. Raises OSError when the disk is full."""
        with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
            file.writelines(lines(self))


def lines(trace: Trace, after: float | None = None) -> Iterator[str]:
    """Return the lines of the CSV file of a trace: the columns, then one line per row. If `after` is given, return only
    the rows later than this time in s."""
    text = StringIO(newline="")
    writer = csv.writer(text)
    first = 0
    if after is None:
        writer.writerow([*trace.columns, NOT_GOOD])
        yield text.getvalue()
    else:
        first = int(np.searchsorted(trace.rows[:, 0], after, side="right"))
    forms = ["{}", "{:.0f}", "{:.3f}", *(described(item).file_form for item in trace.items)]
    form = ",".join([*forms, *(["{}"] * len(trace.signals)), "{}"]) + "\r\n"
    not_good = told_not_good([item.path for item in trace.items], trace.qualities[first:])
    for row, told in zip(trace.rows[first:], not_good, strict=True):
        time, *others = row.tolist()
        yield form.format(round(time, 9), *others, told)  # the clock counts ns
