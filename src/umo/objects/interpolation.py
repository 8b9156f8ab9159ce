"""Interpolation that is equally quick for one number and for many, and gives identical results for both.

Beyond their ends both kinds go on along a straight line.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from math import floor
from typing import Self

import numpy as np

from umo.objects.scaling import FloatArray

CELLS = 2048
NEWTON_STEPS = 6
Function = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Values and derivatives at an array of x."""


class Segments:
    """Linear interpolation between points (x, y), x strictly monotonic."""

    def __init__(self, xs: Sequence[float], ys: Sequence[float]) -> None:
        order = slice(None, None, 1 if xs[0] < xs[-1] else -1)
        self._xs, self._ys = np.array(xs, np.float64)[order], np.array(ys, np.float64)[order]
        self._slopes = np.diff(self._ys) / np.diff(self._xs)
        self._inner = self._xs[1:-1]
        self._lists = [each.tolist() for each in (self._inner, self._xs, self._ys, self._slopes)]

    def one(self, x: float) -> float:
        inner, xs, ys, slopes = self._lists
        i = bisect_right(inner, x)
        return ys[i] + slopes[i] * (x - xs[i])  # type: ignore[no-any-return]

    def many(self, xs: FloatArray) -> FloatArray:
        i = np.searchsorted(self._inner, xs, side="right")
        found: FloatArray = self._ys[i] + self._slopes[i] * (xs - self._xs[i])
        return found


class Cubics:
    """Cubic Hermite interpolation of a smooth function in `CELLS` equal cells."""

    def __init__(self, xs: FloatArray, ys: FloatArray, slopes: FloatArray) -> None:
        """`xs` are `CELLS` + 1 equidistant points, ascending."""
        step = (xs[-1] - xs[0]) / CELLS
        self._first, self._per_x = float(xs[0]), float(1.0 / step)
        chord = np.diff(ys) / step
        a2 = (3.0 * chord - 2.0 * slopes[:-1] - slopes[1:]) / step
        a3 = (slopes[:-1] + slopes[1:] - 2.0 * chord) / step**2
        ends = [0.0]
        self._table = (  # with a cell before the first and one after the last, which are straight lines
            np.concatenate([xs[:1], xs]),
            np.concatenate([ys[:1], ys]),
            np.concatenate([slopes[:1], slopes]),
            np.concatenate([ends, a2, ends]),
            np.concatenate([ends, a3, ends]),
        )
        self._rows = list(zip(*(column.tolist() for column in self._table), strict=True))

    @classmethod
    def both_ways(cls, function: Function, low: float, high: float) -> tuple[Self, Self]:
        """A strictly monotonic function from `low` to `high`, and its inverse, which Newton's method finds."""
        xs = np.linspace(low, high, CELLS + 1)
        ys, slopes = function(xs)
        start = Segments(ys.tolist(), xs.tolist())
        targets = np.linspace(ys.min(), ys.max(), CELLS + 1)
        found = start.many(targets)
        for _ in range(NEWTON_STEPS):
            values, steepness = function(found)
            found = found - (values - targets) / steepness
        return cls(xs, ys, slopes), cls(targets, found, 1.0 / function(found)[1])

    def one(self, x: float) -> float:
        cell = floor(min(max((x - self._first) * self._per_x, -1.0), CELLS))
        at, a0, a1, a2, a3 = self._rows[cell + 1]
        away = x - at
        return ((a3 * away + a2) * away + a1) * away + a0  # type: ignore[no-any-return]

    def many(self, xs: FloatArray) -> FloatArray:
        place = xs - self._first
        place *= self._per_x
        np.maximum(place, -1.0, out=place)
        np.minimum(place, CELLS, out=place)
        cells = np.floor(place).astype(np.int64)
        cells += 1
        at, a0, a1, a2, a3 = self._table
        away = xs - at.take(cells)
        found = a3.take(cells)
        for column in (a2, a1, a0):
            found *= away
            found += column.take(cells)
        return found
