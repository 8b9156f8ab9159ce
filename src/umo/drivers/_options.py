"""Checks of the options of drivers. Each raises a WiringError that names the option and its valid values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from umo.duration import seconds
from umo.errors import DeclarationError, WiringError


def within(name: str, value: Any, least: int, most: int, why: str = "") -> int:
    """A whole number within limits, as it is."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise WiringError(f"{name} must be a whole number from {least} to {most}{why}, not {value!r}")
    return value


def one_of(name: str, value: object, known: Sequence[object]) -> None:
    if value not in known:
        raise WiringError(f"{name} must be one of {', '.join(map(repr, known))}, not {value!r}")


def duration(name: str, value: str | float) -> float:
    """s, from a number or a text such as "200 ms"; up to an hour."""
    try:
        found = seconds(value)
    except DeclarationError:
        found = 0.0
    if not 0.0 < found <= 3600.0:
        raise WiringError(f'{name} must be a time such as "200 ms", above 0 and up to an hour, not {value!r}')
    return found
