"""Units and ranges of numbers that are given or changed from outside: arguments of actions, numbers of compounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from math import inf, isfinite
from sys import float_info
from typing import Any, Protocol

from umo.digits import number_text
from umo.errors import DeclarationError, RangeError
from umo.objects.presentation.value_text import measure, span
from umo.objects.truth import checked_truth
from umo.objects.units import check_unit
from umo.text import cut_repr

MAX_NAMED = 2**53
"""The largest number that may have a name: a float can represent every whole number up to this one."""


class Ranged(Protocol):
    """An object with a unit and a range: a digital object."""

    @property
    def units(self) -> str: ...
    @property
    def minimum(self) -> float: ...
    @property
    def maximum(self) -> float: ...


@dataclass(frozen=True)
class Range:
    """Unit and bounds of a number: `Range("um", 0.0, 80_000.0)`. Both bounds are included. The unit is a string that
    pint knows; "" means a plain number. An infinite bound sets no limit. Raises DeclarationError if the unit is not
    known or there is no number between the bounds.
    """

    unit: str
    minimum: float
    maximum: float

    def __post_init__(self) -> None:
        check_unit(self.unit)
        for bound in (self.minimum, self.maximum):
            if isinstance(bound, bool) or not isinstance(bound, int | float):
                raise DeclarationError(f"a bound of a Range is a number, not {bound!r}")
            if isinstance(bound, int) and not -float_info.max <= bound <= float_info.max:
                raise DeclarationError(
                    "a bound of a Range is an integer that no float can hold; to have no bound, leave it out"
                )
        if not self.minimum <= self.maximum:
            raise DeclarationError(f"the minimum {self.minimum!r} is above the maximum {self.maximum!r}")

    @classmethod
    def of(cls, item: Ranged) -> Range:
        """Return the range of an object: the range of the encoder for a position, the range of the actuator for an
        output."""
        return cls(item.units, item.minimum, item.maximum)

    def check(self, name: str, value: object) -> float:
        """Return the value as a float. Raises RangeError if it is not a finite number within the range."""
        return float(self.checked(name, value))

    def check_whole(self, name: str, value: object) -> int:
        """Return the value as an exact int. Raises RangeError if it is not a whole number within the range."""
        number = self.checked(name, value)
        if number != int(number):
            raise RangeError(f"{name}: {value!r} is not a whole number")
        return int(number)

    def admits(self, values: Sequence[object]) -> bool:
        """Return True if `check` accepts each of these values."""
        low, high = max(self.minimum, -float_info.max), min(self.maximum, float_info.max)
        return {*map(type, values)} <= {int, float} and all(low <= value <= high for value in values)  # type: ignore[operator]

    def checked(self, name: str, value: object) -> float:
        """Return the value unchanged, an int or a float. Raises RangeError in the cases of `check`, and for an int that
        a float cannot express."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise RangeError(f"{name}: {value!r} is not a number{self._in_unit}")
        if not -float_info.max <= value <= float_info.max:
            what = repr(value) if isinstance(value, float) else "an integer that no float can hold"
            raise RangeError(f"{name}: {what} is not a number{self._in_unit}")
        if not self.minimum <= value <= self.maximum:
            raise RangeError(f"{name}: {measure(value, self.unit)} is {self._outside(value)}")
        return value

    @property
    def _in_unit(self) -> str:
        return f" in {self.unit}" if self.unit else ""

    def _outside(self, value: float) -> str:
        if isfinite(self.minimum) and isfinite(self.maximum):
            return f"outside {span(self.minimum, self.maximum)}"
        return f"below {number_text(self.minimum)}" if value < self.minimum else f"above {number_text(self.maximum)}"

    def describe(self) -> dict[str, Any]:
        """Return the range as plain data; None for an infinite bound."""
        low, high = (bound if isfinite(bound) else None for bound in (self.minimum, self.maximum))
        return {"unit": self.unit, "minimum": low, "maximum": high}


@dataclass(frozen=True)
class Number(Range):
    """Unit, range and use of a number of a machine: `Number("V/mm", 0.0, 3.0, tunable=True)`. A number that is declared
    with a plain `Range` can only be set by a wiring."""

    unit: str = ""
    minimum: float = -inf
    maximum: float = inf
    _: KW_ONLY
    tunable: bool = False
    """True if the number can be changed while the machine runs: by `umo tune number`, by `umo.attach` or on the
    page."""
    shown: bool = False
    """True if the number is shown together with the objects: in frames, trace, plot and `umo show values`."""
    kept: bool = False
    """True if the last value is kept across a restart. This is possible for a float, int, bool or Enum. The number is
    also shown in frames."""
    names: Mapping[int, str] = field(default_factory=dict, hash=False)
    """The names with which the values are shown, such as `{0: "none", 1: "glue"}`. An Enum has its own names. Empty for
    a plain number."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for use in ("tunable", "shown", "kept"):
            checked_truth(use, getattr(self, use))
        if not isinstance(self.names, Mapping):
            raise DeclarationError(f"names={cut_repr(self.names)} are not names by number, such as {{0: 'none'}}")
        for number, name in self.names.items():
            if isinstance(number, bool) or not isinstance(number, int) or abs(number) > MAX_NAMED:
                raise DeclarationError(f"names: {cut_repr(number)} is not a whole number that a float holds exactly")
            if not isinstance(name, str) or not name or not name.isprintable():
                raise DeclarationError(f"names: {cut_repr(name)} is not a name (a text of one line)")
