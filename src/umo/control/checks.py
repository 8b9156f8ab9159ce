"""The settings of control laws, checked in one way where they are declared and where they are set from outside."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from umo.errors import DeclarationError


def _finite(numbers: Any) -> Any:
    return np.isfinite(numbers)


def _not_negative(numbers: Any) -> Any:
    return np.isfinite(numbers) & (numbers >= 0)


def _above_0(numbers: Any) -> Any:
    return numbers > 0


def check_numbers(
    owner: Any,
    *,
    finite: Iterable[str] = (),
    not_negative: Iterable[str] = (),
    above_0: Iterable[str] = (),
) -> None:
    """DeclarationError for an attribute that is not a number, or array of numbers, of its kind. `above_0` may be
    infinite, the others may not."""
    rules: tuple[tuple[Iterable[str], Callable[[Any], Any], str], ...] = (
        (finite, _finite, "a finite number"),
        (not_negative, _not_negative, "finite and not below 0"),
        (above_0, _above_0, "above 0"),
    )
    for names, valid, need in rules:
        for name in names:
            given = getattr(owner, name)
            numbers = np.asarray(given)
            if numbers.dtype.kind not in "fiu" or not np.all(valid(numbers)):
                where = getattr(owner, "path", "") or type(owner).__name__
                raise DeclarationError(f"{where}.{name} must be {need}, not {given!r}")
