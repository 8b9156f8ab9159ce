"""The settings of control laws, checked in the same way when they are declared and when they are set from outside."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import nan
from typing import Any

import numpy as np

from umo.errors import DeclarationError
from umo.objects import Node


def check_numbers(
    owner: Any,
    *,
    finite: Iterable[str] = (),
    not_negative: Iterable[str] = (),
    above_0: Iterable[str] = (),
    arrays: bool = False,
) -> None:
    """Check settings. Raises DeclarationError for an attribute that is not a number of its kind or, with `arrays`, an
    array of such numbers. Only the numbers of `above_0` may be infinite."""
    rules: tuple[tuple[Iterable[str], Callable[[Any], Any], str], ...] = (
        (finite, np.isfinite, "a finite number"),
        (not_negative, lambda numbers: np.isfinite(numbers) & (numbers >= 0), "finite and not below 0"),
        (above_0, lambda numbers: numbers > 0, "above 0"),
    )
    for names, valid, need in rules:
        for name in names:
            given = getattr(owner, name)
            is_array = arrays and isinstance(given, np.ndarray) and given.dtype.kind in "fiu"
            if not np.all(valid(given if is_array else _number(given))):
                where = (owner._path if isinstance(owner, Node) else "") or type(owner).__name__
                raise DeclarationError(f"{where}.{name} must be {need}, not {given!r}")


def _number(given: Any) -> float:
    """Return a number as a float; NaN for anything that a float cannot express."""
    try:
        return float(given) if isinstance(given, int | float | np.number) and not isinstance(given, bool) else nan
    except (TypeError, OverflowError):
        return nan
