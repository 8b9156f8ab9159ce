"""The history of a recording. A short span is read from the file; a long span is drawn from an overview."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from umo.duration import TIME_TOLERANCE
from umo.objects.scaling import FloatArray
from umo.process.frames.run_reader import Frames
from umo.recording.block import Block
from umo.recording.recording import Recording
from umo.recording.scope.history import KeptSamples, ValueHistory, samples
from umo.recording.scope.reduction import Points, reduced

MAX_BYTES = 128 << 20
"""Largest number of bytes of chunks that are kept in memory."""
OVERVIEW_BYTES, MAX_PARTS = 64 << 20, 16
"""Largest number of bytes of the overview, and largest number of points of the overview for each chunk."""
SHORT = 60_000
"""Largest number of periods of a span that is read from the file. A longer span is drawn from the overview."""


class Chunk(NamedTuple):
    """A chunk of the file in memory."""

    frames: Frames
    samples: KeptSamples


class RecordedHistory(ValueHistory):
    """The history of a whole recording. The constructor reads the recording once. Any thread may read."""

    def __init__(
        self,
        recording: Recording,
        seen: Callable[[Block], None] = lambda block: None,
        tell: Callable[[float], None] = lambda share: None,
    ) -> None:
        """`seen` is called with each block; `tell` is called with the share that was read."""
        layout = recording.layout
        super().__init__(len(layout.objects) + len(layout.signals))
        self._recording = recording
        self._parts = _parts(recording.chunks, self._columns)
        self._starts: list[float] = []
        self._numbers: list[int] = []
        """The numbers of the chunks that have frames. `_starts`: the time in s at which each of them begins."""
        self._counts: list[int] = []
        self._end = 0.0
        self._read: OrderedDict[int, Chunk] = OrderedDict()
        self._lock = Lock()
        points = [point for number in range(recording.chunks) for point in self._seen(number, seen, tell)]
        times, low, high = zip(*points, strict=True) if points else ((), (), ())
        self._overview = Points(np.array(times), _rows(low, self._columns), _rows(high, self._columns))

    def _seen(
        self, number: int, seen: Callable[[Block], None], tell: Callable[[float], None]
    ) -> Iterator[tuple[float, FloatArray, FloatArray]]:
        """Yield the points of the overview of a chunk: a time, and the smallest and the largest value of each
        column."""
        blocks = self._recording.chunk(number)
        frames = _joined(blocks)
        tell((number + 1) / self._recording.chunks)
        if not len(frames):
            return
        self._numbers.append(number)
        self._starts.append(float(frames["time"][0]))
        self._counts.append(len(frames))
        self._end = float(frames["time"][-1])
        for block in blocks:
            seen(block)
        rows, size = samples(frames), -(-len(frames) // self._parts)
        for first in range(0, len(rows), size):
            part = rows[first : first + size]
            yield float(frames["time"][first]), np.fmin.reduce(part), np.fmax.reduce(part)

    # As of a history -----------------------------------------------------------------------------------

    @property
    def start(self) -> float:
        return self._starts[0] if self._starts else 0.0

    @property
    def stop(self) -> float:
        return self._end

    def parts(self, start: float, stop: float) -> Iterator[KeptSamples]:
        for place in range(max(bisect_right(self._starts, start) - 1, 0), len(self._starts)):
            if self._starts[place] > stop:
                return
            times, values = self.chunk(place).samples
            begin, end = int(np.searchsorted(times, start, "left")), int(np.searchsorted(times, stop, "right"))
            if begin < end:
                yield KeptSamples(times[begin:end], values[:, begin:end])

    def points(self, start: float, stop: float, columns: Sequence[int], step: float, period: float) -> Points:
        if self.is_short(start, stop):
            return reduced(*self.between(start, stop, columns), step, period)
        times, low, high = self._overview.times, self._overview.low, self._overview.high
        first = max(int(np.searchsorted(times, start, "right")) - 1, 0)
        end, chosen = int(np.searchsorted(times, stop, "right")), list(columns)
        lows = reduced(times[first:end], low[chosen, first:end], step, 0.0)
        highs = reduced(times[first:end], high[chosen, first:end], step, 0.0)
        return Points(lows.times, lows.low, highs.high)

    def is_short(self, start: float, stop: float) -> bool:
        first, last = bisect_right(self._starts, start) - 1, bisect_right(self._starts, stop)
        return sum(self._counts[max(first, 0) : last]) <= SHORT or last - first <= 2

    # Frames --------------------------------------------------------------------------------------------

    def at(self, time: float) -> tuple[int, Chunk, int]:
        """Return the frame at a time: the number of its chunk, the chunk, and the index of the frame in it. For an
        earlier time return the first frame."""
        time += TIME_TOLERANCE
        place = max(bisect_right(self._starts, time) - 1, 0)
        chunk = self.chunk(place)
        return place, chunk, max(int(np.searchsorted(chunk.samples.times, time, "right")) - 1, 0)

    def chunk(self, place: int) -> Chunk:
        """Return a chunk, by its index among the chunks that have frames. Any thread may call it."""
        with self._lock:
            if place in self._read:
                self._read.move_to_end(place)
                return self._read[place]
        frames = _joined(self._recording.chunk(self._numbers[place]))
        kept = KeptSamples(np.ascontiguousarray(frames["time"]), np.ascontiguousarray(samples(frames).T))
        found = Chunk(frames, kept)
        with self._lock:
            self._read[place] = found
            while len(self._read) > 2 and sum(map(_bytes, self._read.values())) > MAX_BYTES:
                self._read.popitem(last=False)
        return found


def _parts(chunks: int, columns: int) -> int:
    """Return the number of points of the overview for each chunk."""
    return min(max(OVERVIEW_BYTES // max(16 * chunks * columns, 1), 1), MAX_PARTS)


def _bytes(chunk: Chunk) -> int:
    return int(chunk.frames.nbytes + chunk.samples.values.nbytes)


def _rows(parts: Sequence[FloatArray], columns: int) -> FloatArray:
    return np.ascontiguousarray(np.array(parts).T) if parts else np.zeros((columns, 0))


def _joined(blocks: Sequence[Block]) -> Any:
    """Return the frames of some blocks in their original dtype. `numpy.concatenate` would remove the gaps between the
    fields."""
    if len(blocks) == 1:
        return blocks[0].frames
    if not blocks:
        return np.zeros(0, [("time", "<f8")])
    dtype = blocks[0].frames.dtype
    data = b"".join(block.frames.tobytes() for block in blocks)
    return np.frombuffer(data, dtype)
