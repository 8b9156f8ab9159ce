"""Interpolation that is equally quick for one number and for an array, and gives identical results for both.

Beyond its ends a curve continues along a straight line.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import cached_property
from math import floor
from typing import Any, NamedTuple, Self

import numpy as np

from umo.objects.scaling import FloatArray, IntArray

NEWTON_STEPS = 6
"""Number of steps of Newton's method for the inverse."""
Function = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function that returns values and derivatives at an array of x."""


def horner(coefficients: Sequence[float], xs: FloatArray) -> FloatArray:
    """Return c0 + c1 x + c2 x^2 + ... by Horner's method."""
    result = np.full_like(xs, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        result = result * xs + coefficient
    return result


class CurveTable(NamedTuple):
    """A curve in the form for C (`generate/runtime/umo_curves.h`)."""

    cubic: bool
    size: int
    """The number of points, or of cells."""
    first: float
    """For cubics: the start of the first cell."""
    per_x: float
    """For cubics: cells per unit of x."""
    numbers: bytes
    """The columns one after the other, as doubles."""


class Segments:
    """Linear interpolation between points (x, y), where x is strictly monotonic."""

    def __init__(self, xs: Sequence[float], ys: Sequence[float]) -> None:
        order = slice(None, None, 1 if xs[0] < xs[-1] else -1)
        self._xs, self._ys = np.array(xs, np.float64)[order], np.array(ys, np.float64)[order]
        self._slopes = np.diff(self._ys) / np.diff(self._xs)
        self._inner = self._xs[1:-1]
        self._lists = [each.tolist() for each in (self._inner, self._xs, self._ys, self._slopes)]

    @cached_property
    def in_c(self) -> CurveTable:
        numbers = np.concatenate((self._xs, self._ys, self._slopes)).tobytes()
        return CurveTable(False, len(self._xs), 0.0, 0.0, numbers)

    def one(self, x: float) -> float:
        inner, xs, ys, slopes = self._lists
        i = bisect_right(inner, x)
        return ys[i] + slopes[i] * (x - xs[i])  # type: ignore[no-any-return]

    def many(self, xs: FloatArray) -> FloatArray:
        i = np.searchsorted(self._inner, xs, side="right")
        found: FloatArray = self._ys[i] + self._slopes[i] * (xs - self._xs[i])
        return found


class Cubics:
    """Cubic Hermite interpolation of a smooth function in equal cells."""

    def __init__(self, xs: FloatArray, ys: FloatArray, slopes: FloatArray) -> None:
        """`xs` are equidistant points, ascending."""
        self.cells = len(xs) - 1
        step = (xs[-1] - xs[0]) / self.cells
        self.first, self.per_x = float(xs[0]), float(1.0 / step)
        chord = np.diff(ys) / step
        a2 = (3.0 * chord - 2.0 * slopes[:-1] - slopes[1:]) / step
        a3 = (slopes[:-1] + slopes[1:] - 2.0 * chord) / step**2
        ends = [0.0]
        self.table = (  # with a cell before the first and one after the last, which are straight lines
            np.concatenate([xs[:1], xs]),
            np.concatenate([ys[:1], ys]),
            np.concatenate([slopes[:1], slopes]),
            np.concatenate([ends, a2, ends]),
            np.concatenate([ends, a3, ends]),
        )

    @classmethod
    def both_ways(cls, function: Function, low: float, high: float, cells: int) -> tuple[Self, Self]:
        """Return the interpolation of a strictly monotonic function from `low` to `high`, and of its inverse, which
        Newton's method finds."""
        xs = np.linspace(low, high, cells + 1)
        ys, slopes = function(xs)
        start = Segments(ys.tolist(), xs.tolist())
        targets = np.linspace(ys.min(), ys.max(), cells + 1)
        found = start.many(targets)
        for _ in range(NEWTON_STEPS):
            values, steepness = function(found)
            found = found - (values - targets) / steepness
        return cls(xs, ys, slopes), cls(targets, found, 1.0 / function(found)[1])

    @cached_property
    def in_c(self) -> CurveTable:
        return CurveTable(True, self.cells, self.first, self.per_x, np.concatenate(self.table).tobytes())

    @cached_property
    def _rows(self) -> list[tuple[float, ...]]:
        return list(zip(*(column.tolist() for column in self.table), strict=True))

    def one(self, x: float) -> float:
        cell = floor(min(max((x - self.first) * self.per_x, -1.0), self.cells))
        at, a0, a1, a2, a3 = self._rows[cell + 1]
        away = x - at
        return ((a3 * away + a2) * away + a1) * away + a0

    def many(self, xs: FloatArray) -> FloatArray:
        return _evaluate(xs, self.first, self.per_x, self.cells, 1, self.table)


class CubicsOfMany:
    """A separate curve for each element of an array, evaluated in one calculation."""

    def __init__(self, each: Sequence[Cubics]) -> None:
        begins: dict[Cubics, int] = {}
        end = 0
        for one in each:
            if one not in begins:
                begins[one] = end
                end += one.cells + 2
        self._begins = np.array([begins[one] + 1 for one in each])
        self._first, self._per_x, self._cells = np.array([(one.first, one.per_x, one.cells) for one in each]).T.copy()
        self._table = tuple(map(np.concatenate, zip(*(one.table for one in begins), strict=True)))

    def many(self, xs: FloatArray) -> FloatArray:
        return _evaluate(xs, self._first, self._per_x, self._cells, self._begins, self._table)


def _evaluate(
    xs: FloatArray, first: Any, per_x: Any, cells: Any, begins: Any, table: tuple[FloatArray, ...]
) -> FloatArray:
    """Evaluate each x in its cell. `begins` is the row of the first cell."""
    place = xs - first
    place *= per_x
    np.maximum(place, -1.0, out=place)
    np.minimum(place, cells, out=place)
    rows = np.floor(place).astype(np.int64)
    rows += begins
    at, a0, a1, a2, a3 = table
    away = xs - at.take(rows)
    found: FloatArray = a3.take(rows)
    for column in (a2, a1, a0):
        found *= away
        found += column.take(rows)
    return found


Group = tuple[Any, IntArray | None]
"""An interpolation, and the indices of its elements; None means all elements."""


def groups_of(each: Sequence[Any]) -> list[Group]:
    """Return the calculations on an array in which each element has its own function. In `each`, an element is an
    object with `many`, or None for no function."""
    cubics = [(place, one) for place, one in enumerate(each) if isinstance(one, Cubics)]
    others: dict[Any, list[int]] = {}
    for place, one in enumerate(each):
        if one is not None and not isinstance(one, Cubics):
            others.setdefault(one, []).append(place)
    found: list[tuple[Any, list[int]]] = list(others.items())
    if cubics:
        places, ones = zip(*cubics, strict=True)
        found.append((ones[0] if len(set(ones)) == 1 else CubicsOfMany(ones), list(places)))
    return [(many, None if len(places) == len(each) else np.array(places)) for many, places in found]
