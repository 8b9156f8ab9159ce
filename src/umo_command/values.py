"""Converts values that a user types."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from umo.errors import DeclarationError, OptionError, RangeError, StateError
from umo.objects.units import convert, line_between
from umo.text import did_you_mean

TRUE, FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


CONVERTED_DIGITS = 12
"""Number of significant digits of a number that is converted from another unit. The conversion has rounding errors in
further digits: 194 degF would be 89.9999999999976 degC."""


def number(name: str, text: str, unit: str) -> float:
    """Return a number in `unit`. It is given alone, or with a unit such as "80 mm"; then it has 12 significant digits.
    An integer stays an integer, because a float would change integers beyond 2**53. Raises RangeError if the word is
    not a number, or the number is not finite."""
    return _number(name, text, unit, is_difference=False)


def difference(name: str, text: str, unit: str) -> float:
    """Return a number like `number`, but converted as a difference: 10 K are 10 °C."""
    return float(_number(name, text, unit, is_difference=True))


def _number(name: str, text: str, unit: str, is_difference: bool) -> float:
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if match is None:
        raise RangeError(f"{name}: {text!r} is not a number{f' in {unit}' if unit else ''}")
    if re.match(r",\d", match[2]):
        raise RangeError(f"{name}: {text!r} is not a number; write {text.strip().replace(',', '.', 1)}")
    try:
        value = _converted(float(match[1]), match[2] or unit, unit, is_difference)
    except DeclarationError as error:
        raise RangeError(f"{name}: {error}") from None
    if not math.isfinite(value):
        raise RangeError(f"{name}: {text!r} is too large for a number{f' in {unit}' if unit else ''}")
    is_whole = match[2] in ("", unit) and re.fullmatch(r"[-+]?\d+", match[1])
    return int(match[1]) if is_whole else value


def _converted(value: float, source: str, target: str, is_difference: bool) -> float:
    """Return a number in another unit, rounded to 12 significant digits of the number or of the offset of the units,
    whichever is larger: 32 degF are 0 degC."""
    found = convert(value, source, target)
    if source == target:
        return found
    if is_difference:
        found, line = found - convert(0.0, source, target), None
    else:
        line = line_between(source, target)
    size = max(abs(found), abs(line[1]) if line is not None else 0.0)
    if not 0.0 < size < math.inf:
        return found
    return round(found, max(CONVERTED_DIGITS - 1 - math.floor(math.log10(size)), 0)) + 0.0  # never -0.0


def state(name: str, text: str, states: Sequence[str]) -> str:
    """Return the state with a name in capital or small letters. Raises StateError if there is no such state."""
    if text in states:
        return text
    for each in states:
        if each.casefold() == text.casefold():
            return each
    raise StateError(f"{name} has no state {text!r}{did_you_mean(text.upper(), states)}: {', '.join(states)}")


def argument(path: str, about: dict[str, Any], text: str) -> Any:
    """Return an argument of an action, converted as the declaration describes it."""
    name, kind = f"{path}: {about['name']}", about["kind"]
    if kind in ("number", "integer"):
        return number(name, text, about["unit"])
    if kind == "bool":
        if text.lower() not in (*TRUE, *FALSE):
            raise RangeError(f"{name}: {text!r} is not true or false")
        return text.lower() in TRUE
    if kind == "choice":  # as it is shown: `production`
        return next((each for each in about["choices"] if each.casefold() == text.casefold()), text)
    return text


def check_file(option: str, file: Path | None) -> None:
    """Raise RangeError if the file cannot be written. This is called before anything runs."""
    if file is None:
        return
    if file.is_dir() or not file.parent.is_dir():
        raise RangeError(f"{option} {file}: {'is a folder' if file.is_dir() else f'there is no folder {file.parent}'}")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise RangeError(f"{option} {file}: cannot be written")


def check_picture(path: Path | None) -> None:
    """Raise OptionError unless a file for a plot is a .png."""
    if path is not None and path.suffix != ".png":
        raise OptionError(f"{path.name}: a plot is a .png")
