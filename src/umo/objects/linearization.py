"""Non-linear calibration: the function from the electrical quantity to the value in units.

    value = f(x), x = raw * resolution + zero_offset

x is the electrical quantity that the converter measures or outputs, for example in mV; f is a `Linearization`. f is
strictly monotonic over the range of the object, so it has an inverse. Beyond its ends f continues along a straight
line: a table along its end segments, any other function along its end tangents.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from math import inf, isfinite
from typing import Any, Self, cast

import numpy as np

from umo.errors import DeclarationError
from umo.objects.interpolation import Cubics, CurveTable, Segments, groups_of, horner
from umo.objects.presentation.value_text import span
from umo.objects.scaling import BoolArray, FloatArray
from umo.objects.units import same_unit


class Linearization(ABC):
    """A strictly monotonic function from an electrical quantity to a value in units, and its inverse. Two
    linearizations are equal if they are the same function. The scalar and the array methods give identical numbers."""

    units: str | None = None
    """The units of the value; None means those of the object."""
    _forward: Cubics | Segments
    _inverse: Cubics | Segments

    @abstractmethod
    def over(self, minimum: float, maximum: float) -> Self:
        """Return this function prepared for an object with the given range. Raises DeclarationError unless the function
        is strictly monotonic in this range."""

    def to_value(self, x: float) -> float:
        """Return the value for an electrical quantity."""
        return self._forward.one(x)

    def to_values(self, xs: FloatArray) -> FloatArray:
        """Convert an array of electrical quantities, of shape (n,), to values."""
        return self._forward.many(xs)

    def to_input(self, value: float) -> float:
        """Return the electrical quantity for a value."""
        return self._inverse.one(value)

    def to_inputs(self, values: FloatArray) -> FloatArray:
        """Convert an array of values, of shape (n,), to electrical quantities."""
        return self._inverse.many(values)


@dataclass(frozen=True)
class LookupTable(Linearization):
    """Linear interpolation in a table: `LookupTable([0.0, 1.0, 2.0], [0.0, 30.0, 80.0])`. Both columns are strictly
    monotonic. Beyond the table its end segments continue."""

    inputs: Sequence[float]
    """The electrical quantities."""
    values: Sequence[float]
    """Values in the unit of the object."""

    def __post_init__(self) -> None:
        for name in ("inputs", "values"):
            column = _numbers(name, getattr(self, name))
            object.__setattr__(self, name, column)
            steps = np.diff(column)
            if not ((steps > 0).all() or (steps < 0).all()):
                raise DeclarationError(f"the {name} of a table must be strictly monotonic")
        if len(self.inputs) != len(self.values):
            raise DeclarationError(
                f"a table must have as many values as inputs: it has {len(self.inputs)} inputs and "
                f"{len(self.values)} values"
            )

    @cached_property
    def _forward(self) -> Segments:  # type: ignore[override]
        return Segments(self.inputs, self.values)

    @cached_property
    def _inverse(self) -> Segments:  # type: ignore[override]
        return Segments(self.values, self.inputs)

    def over(self, minimum: float, maximum: float) -> Self:
        check_covers(self, minimum, maximum, min(self.values), max(self.values))
        return self

    def __str__(self) -> str:
        return f"table of {len(self.inputs)} points"


@dataclass(frozen=True)
class Polynomial(Linearization):
    """A polynomial, value = c0 + c1 x + c2 x^2 + ...: `Polynomial([c0, c1, c2])`. Its values are accurate to 1e-9 of
    the range.

    If the polynomial has several strictly monotonic parts, the part that covers the range of the object is used; beyond
    the range the tangents of this part continue. If several parts cover the range, `domain` must give the two
    electrical quantities (from, to) between which the polynomial is used.
    """

    coefficients: Sequence[float]
    domain: Sequence[float] = (-inf, inf)

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", _numbers("coefficients", self.coefficients))
        if self.domain == (-inf, inf):
            return
        object.__setattr__(self, "domain", _numbers("domain", self.domain))
        if len(self.domain) != 2 or self.domain[0] >= self.domain[1]:
            raise DeclarationError(f"the domain of a polynomial is [from, to], not {list(self.domain)}")

    @cached_property
    def _derivative(self) -> tuple[float, ...]:
        return tuple(i * c for i, c in enumerate(self.coefficients))[1:]

    def over(self, minimum: float, maximum: float) -> Self:
        start, end = self.domain
        slack = 1e-9 * (end - start) if isfinite(end - start) else 0.0
        at_ends = [
            [x for x in _real_roots(self.coefficients, value) if start - slack <= x <= end + slack]
            for value in (minimum, maximum)
        ]
        turns = _real_roots(self._derivative, 0.0)
        found = {
            (low, high)
            for low, high in map(sorted, product(*at_ends))
            if low < high and not any(low <= x <= high for x in turns)
        }
        if not found:
            what = f"does not cover {span(minimum, maximum)}, or is not strictly monotonic there"
            raise DeclarationError(f"the {self} {what}")
        if len(found) > 1:
            parts = " and ".join(f"{span(low, high)}" for low, high in sorted(found))
            raise DeclarationError(f"the {self} covers {span(minimum, maximum)} at x = {parts}; name one as `domain`")
        bound = replace(self, domain=found.pop())
        bound._both  # noqa: B018  (DeclarationError if it is too uneven)
        return bound

    @cached_property
    def _both(self) -> tuple[Cubics, Cubics]:
        return _both_ways(self)

    def _at(self, xs: FloatArray) -> tuple[FloatArray, FloatArray]:
        return horner(self.coefficients, xs), horner(self._derivative, xs)

    @property
    def _forward(self) -> Cubics:  # type: ignore[override]
        return self._both[0]

    @property
    def _inverse(self) -> Cubics:  # type: ignore[override]
        return self._both[1]

    def __str__(self) -> str:
        return f"polynomial of degree {len(self.coefficients) - 1}"


@lru_cache(maxsize=1000)
def _both_ways(polynomial: Polynomial) -> tuple[Cubics, Cubics]:
    """Return the polynomial and its inverse as cubics, with the least number of cells that keeps the error within 1e-9
    of the range."""
    with np.errstate(all="ignore"):
        xs = np.linspace(polynomial.domain[0], polynomial.domain[1], 5003)
        values = horner(polynomial.coefficients, xs)
        for cells in (16, 64, 256, 1024, 4096):
            forward, inverse = Cubics.both_ways(polynomial._at, polynomial.domain[0], polynomial.domain[1], cells)
            pairs = ((forward.many(xs), values), (inverse.many(values), xs))
            if all(np.abs(found - exact).max() <= 1e-9 * np.ptp(exact) for found, exact in pairs):
                return forward, inverse
    raise DeclarationError(f"the {polynomial} is too uneven over the range; use a LookupTable")


def fitted(linearization: object, units: str, minimum: float, maximum: float) -> Linearization:
    """Return the linearization for an object of these units and range. Raises DeclarationError if it does not fit."""
    if not isinstance(linearization, Linearization):
        raise DeclarationError(f"linearization={linearization!r} is not a Polynomial, a LookupTable or a Thermocouple")
    if linearization.units is not None and not same_unit(linearization.units, units):
        raise DeclarationError(f"the {linearization} gives {linearization.units}, the object has {units}")
    return linearization.over(minimum, maximum)


class Linearizations:
    """The linearizations of neighbouring objects, as one function on arrays."""

    def __init__(self, each: Sequence[Linearization | None]) -> None:
        same = {one: one for one in each if one is not None}  # equal ones are one
        ones = [None if one is None else same[one] for one in each]
        self._each = [None if one is None else _forward_of(one) for one in ones]
        self._forward = groups_of(self._each)
        self._inverse = groups_of([None if one is None else _inverse_of(one) for one in ones])

    def __bool__(self) -> bool:
        return bool(self._forward)

    @property
    def in_c(self) -> list[tuple[int, CurveTable]] | None:
        """Return each curve from electrical quantities to values, with its index, in the form for C; None if one of the
        curves is user-defined."""
        curves = [(place, one) for place, one in enumerate(self._each) if one is not None]
        if any(isinstance(one, _OneByOne) for _, one in curves):
            return None
        return [(place, cast(Cubics | Segments, one).in_c) for place, one in curves]

    def to_values(self, xs: FloatArray) -> FloatArray:
        """Convert electrical quantities to values, in a new array."""
        found = xs
        for function, places in self._forward:
            if places is None:
                return cast(FloatArray, function.many(xs))
            if found is xs:
                found = xs.copy()
            found[places] = function.many(xs[places])
        return found

    def to_inputs(self, values: FloatArray, where: BoolArray) -> FloatArray:
        """Convert values to electrical quantities, in a new array, at the indices where the mask is True; the other
        elements are kept."""
        found = values.copy()
        for function, places in self._inverse:
            of_group = np.arange(len(values)) if places is None else places
            if isinstance(function, _OneByOne):  # the user's own: it is not asked for the others
                of_group = of_group[where[of_group]]
            found[of_group] = function.many(values[of_group])
        found[~where] = values[~where]
        return found


@dataclass(frozen=True)
class _OneByOne:
    """The application of a user-defined function to an array."""

    one: Callable[[float], float]

    def many(self, xs: FloatArray) -> FloatArray:
        return np.array([self.one(x) for x in xs.tolist()], np.float64)


def _forward_of(each: Linearization) -> Cubics | Segments | _OneByOne:
    return each._forward if type(each).to_value is Linearization.to_value else _OneByOne(each.to_value)


def _inverse_of(each: Linearization) -> Cubics | Segments | _OneByOne:
    return each._inverse if type(each).to_input is Linearization.to_input else _OneByOne(each.to_input)


def _real_roots(coefficients: Sequence[float], value: float) -> list[float]:
    """Return the x at which a polynomial has this value. Where the polynomial only touches the value, there may be two
    that lie close together."""
    shifted = np.trim_zeros(np.array([coefficients[0] - value, *coefficients[1:]]), "b")
    if len(shifted) < 2:
        return []
    try:
        with np.errstate(all="ignore"):
            roots = np.roots(shifted[::-1])
    except np.linalg.LinAlgError:  # of coefficients whose ratio overflows
        return []
    return [float(root.real) for root in roots if abs(root.imag) <= 1e-9 * max(1.0, abs(root))]


def check_covers(what: Linearization, minimum: float, maximum: float, least: float, greatest: float) -> None:
    if not least <= minimum <= maximum <= greatest:
        raise DeclarationError(f"the {what} covers {span(least, greatest)}, not {span(minimum, maximum)}")


def _numbers(name: str, numbers: Any) -> tuple[float, ...]:
    given = numbers.tolist() if isinstance(numbers, np.ndarray) else numbers
    each = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else []
    if len(each) < 2 or any(isinstance(x, bool) or not isinstance(x, int | float) or not isfinite(x) for x in each):
        raise DeclarationError(f"{name} must be a list of at least two finite numbers, not {numbers!r}")
    return tuple(map(float, each))
