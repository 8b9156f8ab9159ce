"""The last minutes of a station in memory: a time and a value of every object and signal for each period."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from umo.frames.reader import Frames
from umo.objects import Quality
from umo.objects.scaling import FloatArray
from umo.scope.reduction import Points, reduced

MAX_SECONDS = 300.0
MAX_BYTES = 128 << 20
MIN_SAMPLES = 1024
"""Samples that are kept of the largest station."""
BLOCKS = 64
"""Blocks that the samples are kept in; the oldest is dropped as a whole."""


class KeptSamples(NamedTuple):
    """Consecutive samples."""

    times: FloatArray
    """s."""
    values: FloatArray
    """One row per column."""


class History:
    """Columns of samples, oldest first. It holds at least `capacity` samples, then drops the oldest.

    One thread adds; any thread may read: samples do not move, and do not change once they are there.
    """

    def __init__(self, columns: int, period: float, seconds: float = MAX_SECONDS, most: int = MAX_BYTES) -> None:
        room = most / (8 * (columns + 1)) / (1 + 1 / BLOCKS)
        self.capacity = max(int(min(seconds / max(period, 1e-6), room)), MIN_SAMPLES)
        self._columns = columns
        self._size = -(-self.capacity // BLOCKS)
        self._most = -(-self.capacity // self._size) + 1
        self._blocks: list[KeptSamples] = []
        """Samples that are filled in. They are replaced, never changed."""
        self._newest = self._new_block()

    def _new_block(self) -> KeptSamples:
        return KeptSamples(np.zeros(self._size), np.zeros((self._columns, self._size)))

    def add(self, times: FloatArray, rows: FloatArray) -> None:
        """Some samples: a time (s, not before the last one) and a row of values for each."""
        while len(times):
            filled = len(self._blocks[-1].times) if self._blocks else self._size
            older = self._blocks[:-1]
            if filled == self._size:
                older, filled, self._newest = self._blocks[-self._most + 1 :], 0, self._new_block()
            end = min(filled + len(times), self._size)
            count = end - filled
            self._newest.times[filled:end] = times[:count]
            self._newest.values[:, filled:end] = rows[:count].T
            self._blocks = [*older, KeptSamples(self._newest.times[:end], self._newest.values[:, :end])]
            times, rows = times[count:], rows[count:]

    def add_frames(self, frames: Frames, columns: Sequence[int] | None = None) -> None:
        """The `samples` of some frames, or these columns of them."""
        rows = samples(frames)
        self.add(frames["time"], rows if columns is None else rows[:, columns])

    @property
    def start(self) -> float:
        """The time of the oldest sample in s; 0 if there is none."""
        return float(self._blocks[0].times[0]) if self._blocks else 0.0

    @property
    def stop(self) -> float:
        """The time of the newest sample in s; 0 if there is none."""
        return float(self._blocks[-1].times[-1]) if self._blocks else 0.0

    def parts(self, start: float, stop: float) -> Iterator[KeptSamples]:
        """The samples from `start` to `stop` (s, both included) of all columns, in parts that need no copy. What there
        is at the call stays there until the parts are read."""
        blocks = self._blocks
        first = max(bisect_left(blocks, start, key=lambda block: float(block.times[0])) - 1, 0)
        return _between(blocks[first:], start, stop)

    def between(self, start: float, stop: float, columns: Sequence[int]) -> KeptSamples:
        """The samples from `start` to `stop` (s, both included): times, and one row for each of these columns."""
        chosen = list(columns)
        parts = [KeptSamples(times, values[chosen]) for times, values in self.parts(start, stop)]
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return KeptSamples(np.zeros(0), np.zeros((len(chosen), 0)))
        return KeptSamples(*(np.concatenate(each, axis=-1) for each in zip(*parts, strict=True)))

    def points(self, start: float, stop: float, columns: Sequence[int], step: float, period: float) -> Points:
        """The samples of `between`, reduced to one point per `step` s."""
        return reduced(*self.between(start, stop, columns), step, period)

    def is_short(self, start: float, stop: float) -> bool:
        """Whether `between` takes no long time."""
        return True


def samples(frames: Frames) -> FloatArray:
    """A row for each frame: objects, then signals. NaN: the value was BAD, or there is none."""
    values, quality = frames["values"], frames["quality"]
    if quality.size and quality.max() >= Quality.BAD:
        values = np.where(quality >= Quality.BAD, np.nan, values)
    return np.hstack([values, frames["signals"]])


def _between(blocks: Sequence[KeptSamples], start: float, stop: float) -> Iterator[KeptSamples]:
    for times, values in blocks:
        if times[0] > stop:
            return
        begin, end = int(np.searchsorted(times, start, "left")), int(np.searchsorted(times, stop, "right"))
        if begin < end:
            yield KeptSamples(times[begin:end], values[:, begin:end])
