"""Two recordings on the time of the first one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from umo.duration import TIME_TOLERANCE
from umo.objects.scaling import FloatArray
from umo.recording.recorded_history import RecordedHistory
from umo.recording.scope.history import KeptSamples, ValueHistory
from umo.recording.scope.reduction import Points


class OverlaidHistory(ValueHistory):
    """Two histories on the time of the first one. The second history is shifted so that it begins at the same time as
    the first."""

    def __init__(self, first: RecordedHistory, second: RecordedHistory, columns: int) -> None:
        """`columns`: number of columns of the first history; those of the second one follow."""
        super().__init__(columns + second._columns)
        self._first, self._second, self._split = first, second, columns
        self.shift = first.start - second.start
        """Time in s that is added to the times of the second history."""

    @property
    def start(self) -> float:
        return self._first.start

    @property
    def stop(self) -> float:
        return max(self._first.stop, self._second.stop + self.shift)

    def is_short(self, start: float, stop: float) -> bool:
        return self._first.is_short(start, stop) and self._second.is_short(start - self.shift, stop - self.shift)

    def points(self, start: float, stop: float, columns: Sequence[int], step: float, period: float) -> Points:
        one = [column for column in columns if column < self._split]
        other = [column - self._split for column in columns if column >= self._split]
        first = self._first.points(start, stop, one, step, period)
        if not other:
            return first
        found = self._second.points(start - self.shift, stop - self.shift, other, step, period)
        second = Points(np.round(found.times + self.shift, 9), found.low, found.high)
        if not one:
            return second
        times = np.union1d(np.round(first.times, 9), second.times)
        rows = [self._row(first, second, column, columns) for column in columns]
        low = np.array([_held(points, points.low[row], times) for points, row in rows])
        high = np.array([_held(points, points.high[row], times) for points, row in rows])
        return Points(times, low, high)

    def _row(self, first: Points, second: Points, column: int, columns: Sequence[int]) -> tuple[Points, int]:
        of_first = column < self._split
        before = columns[: list(columns).index(column)]
        return (first if of_first else second), sum((each < self._split) == of_first for each in before)

    def between(self, start: float, stop: float, columns: Sequence[int]) -> KeptSamples:
        points = self.points(start, stop, columns, 0.0, 1.0)
        return KeptSamples(points.times, points.low)

    def parts(self, start: float, stop: float) -> Iterator[KeptSamples]:
        begin = max(start, self.start)
        end = min(stop, self.stop)
        while begin <= end:
            times, values = self.between(begin, min(begin + 10.0, end), range(self._columns))
            kept = times < begin + 10.0
            if kept.any():
                yield KeptSamples(times[kept], values[:, kept])
            begin += 10.0


def _held(points: Points, row: FloatArray, times: FloatArray) -> FloatArray:
    """Return a row at other times: at each time its last value; NaN before its first and after its last point."""
    if not len(points.times):
        return np.full(len(times), np.nan)
    places = np.searchsorted(np.round(points.times, 9), times, "right") - 1
    found = row[np.maximum(places, 0)]
    return np.where((places >= 0) & (times <= points.times[-1] + TIME_TOLERANCE), found, np.nan)
