"""The last minutes of a station in memory: a time and a value of every object and signal for each period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from umo.objects.scaling import FloatArray

SECONDS = 300.0
MOST_BYTES = 128 << 20
FEWEST = 1024
"""Samples that are kept of the largest station."""
SLACK = 1.25
"""Room behind the samples that are kept: they are moved to the front when it is used up."""


class History:
    """Columns of samples, oldest first. It holds at least `capacity` samples, then drops the oldest."""

    def __init__(self, columns: int, period: float, seconds: float = SECONDS, most: int = MOST_BYTES) -> None:
        fitting = min(seconds / max(period, 1e-6), most / (8 * SLACK * (columns + 1)))
        self.capacity = max(int(fitting), FEWEST)
        size = int(self.capacity * SLACK)
        self._times = np.zeros(size)  # the system gives the memory when it is written to
        self._values = np.zeros((columns, size))
        self._count = 0

    def add(self, times: FloatArray, rows: FloatArray) -> None:
        """Some samples: a time (s, not before the last one) and a row of values for each."""
        if len(times) > self.capacity:
            self._count = 0
            times, rows = times[-self.capacity :], rows[-self.capacity :]
        if self._count + len(times) > len(self._times):
            kept = min(self.capacity - len(times), self._count)
            self._times[:kept] = self._times[self._count - kept : self._count].copy()
            for column in self._values:
                column[:kept] = column[self._count - kept : self._count].copy()
            self._count = kept
        end = self._count + len(times)
        self._times[self._count : end] = times
        self._values[:, self._count : end] = rows.T
        self._count = end

    @property
    def times(self) -> FloatArray:
        return self._times[: self._count]

    @property
    def start(self) -> float:
        """The time of the oldest sample in s; 0 if there is none."""
        return float(self._times[0]) if self._count else 0.0

    @property
    def stop(self) -> float:
        """The time of the newest sample in s; 0 if there is none."""
        return float(self._times[self._count - 1]) if self._count else 0.0

    def between(self, start: float, stop: float, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """The samples from `start` to `stop` (s, both included): times, and one row per column."""
        begin = int(np.searchsorted(self.times, start, "left"))
        end = int(np.searchsorted(self.times, stop, "right"))
        chosen: npt.NDArray[np.intp] = np.array(columns, np.intp)
        return self._times[begin:end], self._values[chosen, begin:end]
