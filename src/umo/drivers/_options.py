"""Checks of the options of drivers. Each raises a WiringError that names the option and its valid values."""

from __future__ import annotations

import re
from collections.abc import Sequence

from umo.errors import WiringError

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?) ?(us|ms|s)")
_UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}


def within(name: str, value: int, least: int, most: int, why: str = "") -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise WiringError(f"{name} must be a whole number from {least} to {most}{why}, not {value!r}")


def one_of(name: str, value: object, known: Sequence[object]) -> None:
    if value not in known:
        raise WiringError(f"{name} must be one of {', '.join(map(repr, known))}, not {value!r}")


def duration(name: str, value: str | float) -> float:
    """s, from a number or a text such as "200 ms"; up to an hour."""
    match = _DURATION.fullmatch(value) if isinstance(value, str) else None
    seconds = float(match[1]) * _UNITS[match[2]] if match else value
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 < seconds <= 3600.0:
        raise WiringError(f'{name} must be a time such as "200 ms", above 0 and up to an hour, not {value!r}')
    return float(seconds)
