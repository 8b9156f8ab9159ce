"""The values of a run against time, from any source: a run on this computer or another one, a recording, or a replay.
`ValueHistory` is their common interface. Histories in memory are filled with frames from the ring of a run or of its
mirror (`History`, `ThinnedHistory`), or with the commands of a replay; the history of a file is
`umo.recording.recorded_history.RecordedHistory`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from umo.objects import Quality
from umo.objects.scaling import FloatArray
from umo.process.frames.run_reader import Frames
from umo.recording.scope.reduction import Points, reduced

MAX_SECONDS = 300.0
MAX_BYTES = 128 << 20
MIN_SAMPLES = 1024
"""Number of samples that are kept even for the largest station."""
BLOCKS = 64
"""Number of blocks in which the samples are kept. The oldest block is dropped as a whole."""


class KeptSamples(NamedTuple):
    """Consecutive samples."""

    times: FloatArray
    """Times of the samples in s."""
    values: FloatArray
    """One row per column."""


class ValueHistory(ABC):
    """The interface of histories: columns of samples, oldest first. A run has one column for each object, then one for
    each signal. A sample is NaN if the value was BAD, or if there is none. Times are in s on the cycle's clock."""

    def __init__(self, columns: int) -> None:
        self._columns = columns

    @property
    @abstractmethod
    def start(self) -> float:
        """The time of the oldest sample; 0 if there is none."""

    @property
    @abstractmethod
    def stop(self) -> float:
        """The time of the newest sample; 0 if there is none."""

    @abstractmethod
    def parts(self, start: float, stop: float) -> Iterator[KeptSamples]:
        """Yield the samples of all columns from `start` to `stop`, both included, in parts. The samples that exist at
        the call remain until the parts are read."""

    def between(self, start: float, stop: float, columns: Sequence[int]) -> KeptSamples:
        """Return the samples from `start` to `stop`, both included: times, and one row for each of these columns."""
        chosen = list(columns)
        parts = [KeptSamples(times, values[chosen]) for times, values in self.parts(start, stop)]
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return KeptSamples(np.zeros(0), np.zeros((len(chosen), 0)))
        return KeptSamples(*(np.concatenate(each, axis=-1) for each in zip(*parts, strict=True)))

    def points(self, start: float, stop: float, columns: Sequence[int], step: float, period: float) -> Points:
        """Return the samples of `between`, reduced to one point per `step` s."""
        return reduced(*self.between(start, stop, columns), step, period)

    def is_short(self, start: float, stop: float) -> bool:
        """True if `between` takes little time."""
        return True


class MemoryHistory(ValueHistory):
    """A history of added samples. Only one thread may add."""

    @abstractmethod
    def add(self, times: FloatArray, rows: FloatArray) -> None:
        """Add samples. Each has a time in s, which must not be before that of the last sample, and a row of values."""

    def add_frames(self, frames: Frames, columns: Sequence[int] | None = None) -> None:
        """Add the `samples` of some frames, or these columns of them."""
        rows = samples(frames)
        self.add(frames["time"], rows if columns is None else rows[:, columns])


class History(MemoryHistory):
    """The last minutes of a run. The history keeps at least `capacity` samples, and drops older ones. Any thread may
    read, because samples do not move or change once they are added."""

    def __init__(self, columns: int, period: float, seconds: float = MAX_SECONDS, most: int = MAX_BYTES) -> None:
        super().__init__(columns)
        room = most / (8 * (columns + 1)) / (1 + 1 / BLOCKS)
        self.capacity = max(int(min(seconds / max(period, 1e-6), room)), MIN_SAMPLES)
        self._size = -(-self.capacity // BLOCKS)
        self._most = -(-self.capacity // self._size) + 1
        self._blocks: list[KeptSamples] = []
        """The completed blocks of samples. A block is replaced, never changed."""
        self._newest = self._new_block()

    def _new_block(self) -> KeptSamples:
        return KeptSamples(np.zeros(self._size), np.zeros((self._columns, self._size)))

    def add(self, times: FloatArray, rows: FloatArray) -> None:
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

    @property
    def start(self) -> float:
        return float(self._blocks[0].times[0]) if self._blocks else 0.0

    @property
    def stop(self) -> float:
        return float(self._blocks[-1].times[-1]) if self._blocks else 0.0

    def parts(self, start: float, stop: float) -> Iterator[KeptSamples]:
        blocks = self._blocks
        first = max(bisect_left(blocks, start, key=lambda block: float(block.times[0])) - 1, 0)
        return _between(blocks[first:], start, stop)


class ThinnedHistory(MemoryHistory):
    """The whole run with reduced density. Whenever there are more than `most` samples, every second one is removed.
    Only one thread may add and read."""

    def __init__(self, columns: int, most: int) -> None:
        super().__init__(columns)
        self._most, self._stride, self._seen, self._count = max(most, 2), 1, 0, 0
        self._times: list[FloatArray] = []
        self._rows: list[FloatArray] = []

    def add(self, times: FloatArray, rows: FloatArray) -> None:
        first = -self._seen % self._stride
        self._seen += len(times)
        if first >= len(times):
            return
        self._times.append(np.array(times[first :: self._stride], np.float64))
        self._rows.append(np.array(rows[first :: self._stride], np.float64))
        self._count += len(self._times[-1])
        while self._count > self._most:
            times, values = self._joined()
            self._times, self._rows = [times[::2]], [values.T[::2]]
            self._stride, self._count = 2 * self._stride, len(self._times[0])

    def _joined(self) -> KeptSamples:
        self._times, self._rows = [np.concatenate(self._times)], [np.concatenate(self._rows)]
        return KeptSamples(self._times[0], self._rows[0].T)

    @property
    def start(self) -> float:
        return float(self._times[0][0]) if self._times else 0.0

    @property
    def stop(self) -> float:
        return float(self._times[-1][-1]) if self._times else 0.0

    def parts(self, start: float, stop: float) -> Iterator[KeptSamples]:
        return _between([self._joined()] if self._times else [], start, stop)


def last_good(frames: Frames, before: FloatArray) -> FloatArray:
    """Return the time, in s on the cycle's clock, at which each object last had a reading that was neither STALE nor
    BAD. The time is taken from these frames, or else from `before`. It is NaN if there was no such reading."""
    usable = frames["quality"] < Quality.STALE
    last = len(frames) - 1 - np.argmax(usable[::-1], axis=0)
    return np.where(usable.any(axis=0), frames["time"][last], before)


def samples(frames: Frames) -> FloatArray:
    """Return a row for each frame: objects, then signals. A value is NaN if it was BAD, or if there is none."""
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
