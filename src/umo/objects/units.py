"""Units are pint's; values in the loop are plain floats in the declared unit.

pint is imported with the first declaration, not with umo: it costs 0.2 s (notes: import late, cache).
"""

from __future__ import annotations

import math
import re
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from umo.errors import DeclarationError

if TYPE_CHECKING:
    from pint import UnitRegistry


@cache
def registry() -> UnitRegistry[Any]:
    """umo's one pint registry; it knows `sampling_period`, the unit of the paper's `Timer_Input`."""
    from pint import UnitRegistry

    units: UnitRegistry[Any] = UnitRegistry()
    units.define("sampling_period = [sampling]")
    return units


_DURATION = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([^\W\d]+)")  # pint would calculate "9**9**9 s"


@lru_cache(maxsize=1024)
def check_unit(unit: str) -> str:
    """The unit itself when pint knows it; DeclarationError otherwise."""
    try:
        registry().parse_units(unit)
    except Exception as error:  # pint raises a dozen types, some of them tokenizer errors
        raise DeclarationError(f"{unit!r} is not a unit that pint knows ({error})") from None
    return unit


@lru_cache(maxsize=1024)
def _line(source: str, target: str) -> tuple[float, float]:
    """Factor and offset of the conversion; pint's units are all linear in what umo accepts."""
    zero, one = (registry().Quantity(x, source).to(target).magnitude for x in (0.0, 1.0))
    return one - zero, zero


def convert(value: float, source: str, target: str) -> float:
    """The value in another unit of the same dimension; DeclarationError if there is none."""
    try:
        factor, offset = _line(source, target)
    except Exception as error:
        raise DeclarationError(f"{source!r} cannot be expressed in {target!r} ({error})") from None
    return value * factor + offset


def seconds(duration: str | float) -> float:
    """A duration in s, from a number of seconds or a text such as "20 ms"; finite and not negative."""
    try:
        if isinstance(duration, str):
            number, unit = _DURATION.fullmatch(duration.strip()).groups()  # type: ignore[union-attr]
            value = convert(float(number), unit, "s")
        elif isinstance(duration, bool):
            raise TypeError
        else:
            value = float(duration)
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise DeclarationError(f'{duration!r} is not a duration; write for example "20 ms"') from None
    if not math.isfinite(value) or value < 0:
        raise DeclarationError(f"{duration!r} is not a duration: it must be finite and not negative")
    return value
