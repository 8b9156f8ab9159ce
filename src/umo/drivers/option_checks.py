"""Checks of the options of drivers. Each check returns the value, or raises a WiringError that names the option and its
valid values."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

from umo.duration import seconds_of_setting
from umo.errors import DeclarationError, WiringError
from umo.text import did_you_mean

T = TypeVar("T")


def within(name: str, value: Any, least: int, most: int, why: str = "") -> int:
    """Return the option as a whole number within limits."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise WiringError(f"{name} must be a whole number from {least} to {most}{why}, not {value!r}")
    return value


def one_of(name: str, value: T, known: Sequence[object]) -> T:
    """Check that the value is one of the known values, and return it."""
    if isinstance(value, bool) or value not in known:
        raise WiringError(f"{name} must be one of {', '.join(map(repr, known))}, not {value!r}")
    return value


def truth(name: str, value: object) -> bool:
    """Return the option as True or False."""
    if not isinstance(value, bool):
        raise WiringError(f"{name} must be true or false, not {value!r}")
    return value


def checked_table(name: str, value: Any, known: Collection[str], example: str) -> Mapping[str, Any]:
    """Return a table after checking that all its keys are known."""
    if not isinstance(value, Mapping):
        raise WiringError(f"{name} must be a table such as {example}, not {value!r}")
    for key in value:
        if key not in known:
            raise WiringError(f"{name}: unknown key {key!r}{did_you_mean(str(key), known)}; known: {', '.join(known)}")
    return value


def duration(name: str, value: str | float) -> float:
    """Return a time of at most an hour in s, given as a string such as "200 ms" or a number below 1."""
    try:
        found = seconds_of_setting(value)
    except DeclarationError:
        found = 0.0
    if not 0.0 < found <= 3600.0:
        raise WiringError(f'{name} must be a time such as "200 ms", above 0 and up to an hour, not {value!r}')
    return found
