"""The units, which are those of pint. Values in the loop are plain floats in the declared unit.

pint is imported with the first declaration and not with umo, because the import takes 0.2 s.
"""

from __future__ import annotations

import math
import re
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from umo.errors import DeclarationError, RangeError, text_of
from umo.objects.presentation.value_text import measure
from umo.text import cut_repr, did_you_mean

if TYPE_CHECKING:
    from pint import UnitRegistry


@cache
def registry() -> UnitRegistry[Any]:
    """Return umo's only pint registry, which also has `sampling_period`, the unit of the paper's `Timer_Input`."""
    from pint import UnitRegistry

    units: UnitRegistry[Any] = UnitRegistry()
    units.define("sampling_period = [sampling]")
    return units


_NAME = r"(?:[^\W\d⁰¹²³⁴-⁹]|[°%Δ])[^\W⁰¹²³⁴-⁹]*°?[^\W\d⁰¹²³⁴-⁹]*"
_POWER = r"(?:\s*(?:\*\*|\^)\s*[-+]?\d\d?(?:\.\d)?|⁻?[⁰¹²³⁴-⁹]{1,2})?"
_FACTOR = rf"(?:1|{_NAME}{_POWER})"
_PRODUCT = rf"{_FACTOR}(?:(?:\s*[*/·⋅]\s*|\s+){_FACTOR})*"
_UNIT = re.compile(rf"\s*(?:{_PRODUCT}(?:\s*/\s*\({_PRODUCT}\))?)?\s*")
"""Form of a unit: names, their products and quotients and small powers. Without this check pint would calculate
"9**9**9 mm" for hours."""
_MEASURE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:(?<=\s)|(?![\d.]))(\S.*?)\s*")
"""A number with a unit."""
MAX_LENGTH = 100
"""Largest length of a unit, in characters."""
_USUAL_NAMES = """
    A Hz J K L MPa N Nm Pa V W bar cm count counts dB dBm deg degC g h kHz kJ kN kPa kV kW kg km l m mA mL mV mW mbar
    min ml mm mol ms ohm pH percent ppm rad rpm s sampling_period t um us %
"""
_USUAL = frozenset(_USUAL_NAMES.split())
"""Names of units that pint knows and most machines use. Units made of these names are accepted without pint, because
its import and its registry take 0.3 s at each start."""
LOGARITHMIC_DIGITS = 12
"""The number of significant digits to which a conversion through logarithms is rounded, so that 30 dBm are 1000 mW and
not 1000.0000000000007."""


def check_unit(unit: str) -> str:
    """Return the unit. Raises DeclarationError if pint does not know it."""
    if not isinstance(unit, str):
        raise DeclarationError(f"{cut_repr(unit)} is not a unit; write a string such as mm/s")
    return _checked_unit(unit)


@lru_cache(maxsize=1024)
def _checked_unit(unit: str) -> str:
    if not unit:
        return unit
    if len(unit) > MAX_LENGTH or not _UNIT.fullmatch(unit):
        form = "allowed: names, *, / and small powers"
        raise DeclarationError(f"{unit[:MAX_LENGTH]!r} is not a unit that pint knows ({form})")
    if _USUAL.issuperset(re.findall(_NAME, unit)):
        return unit
    try:
        registry().parse_units(unit)
    except Exception as error:  # pint raises a dozen types, some of them tokenizer errors
        near = did_you_mean(unit, _unit_names())
        raise DeclarationError(f"{unit!r} is not a unit that pint knows ({error}){near}") from None
    return unit


def _unit_names() -> list[str]:
    """Return names of units. Units of the SI are included with their usual prefixes."""
    plain = ("meter", "metre", "second", "gram", "volt", "ampere", "liter", "watt", "hertz", "pascal", "newton", "bar")
    return [*(prefix + each for prefix in ("milli", "micro", "centi", "kilo", "mega") for each in plain), *registry()]


def same_unit(one: str, other: str) -> bool:
    """Return True if pint considers two units the same: "degC" and "degree_Celsius"."""
    if one == other:
        return True
    parse = registry().parse_units
    return bool(parse(one) == parse(other))


def is_quotient(unit: str, dividend: str, divisor: str) -> bool | None:
    """Return whether a unit is the quotient of two units: "V/mm" of "V" and "mm". In a quotient degC and degF are
    differences of temperatures: "percent/K" is the quotient of "percent" and "degC". Return None if a unit has no
    quotient, as logarithmic units such as dBm."""
    registered = registry()
    try:
        quotient, given = registered.parse_units(f"({dividend})/({divisor})"), registered.parse_units(unit)
        if not given.is_compatible_with(quotient):
            return False
        return math.isclose(registered.Quantity(1.0, given).to(quotient).magnitude, 1.0)
    except Exception:  # pint raises many types
        return None


@lru_cache(maxsize=1024)
def line_between(source: str, target: str) -> tuple[float, float] | None:
    """Return factor and offset of the conversion; None if it is not linear, as for logarithmic units such as dBm."""
    zero, one, two, three = (_exactly(x, source, target) for x in (0.0, 1.0, 2.0, 3.0))
    if not math.isclose(two - one, three - two, rel_tol=1e-6):
        return None
    return one - zero, zero


def _exactly(value: float, source: str, target: str) -> float:
    """Return a value that is converted by pint's own quantities. This takes 20 us; a linear conversion takes 0.2 us."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(registry().Quantity(value, source).to(target).magnitude)


@lru_cache(maxsize=1024)
def _angle(unit: str) -> float:
    """Return the power of an angle in a unit: 1 in "rpm", 0 in "Hz". Angles have no dimension, so pint treats 1 Hz as 1
    rad/s, while a user means one revolution per second."""
    found: dict[str, Any] = dict(registry().Quantity(1.0, unit).to_root_units().unit_items())
    return float(found.get("radian", 0.0))


def convert(value: float, source: str, target: str) -> float:
    """Return the value in another unit of the same dimension. Raises DeclarationError if the units have different
    dimensions, or if only one of the two contains an angle ("Hz" and "rpm"). Raises RangeError for a value that the
    other unit cannot express (0 mW in dBm)."""
    check_unit(source)
    check_unit(target)
    if _angle(source) != _angle(target):
        raise DeclarationError(f"{source!r} cannot be converted to {target!r}: only one of them contains an angle")
    try:
        line = line_between(source, target)
        if line is not None:
            return value * line[0] + line[1]
        converted = _exactly(value, source, target)
    except Exception as error:
        if isinstance(error, TypeError) and type(error).__name__ == "DimensionalityError":  # pint shows base units
            raise DeclarationError(f"{source!r} cannot be converted to {target!r}") from None
        raise DeclarationError(f"{source!r} cannot be expressed in {target!r} ({text_of(error)})") from None
    if math.isfinite(value) and not math.isfinite(converted):
        raise RangeError(f"{measure(value, source)} cannot be expressed in {target}")
    return float(f"{converted:.{LOGARITHMIC_DIGITS}g}")


def number_with_unit(unit: str, text: str) -> float:
    """Return the number that a text with a unit, such as "1.5 min", stands for in this unit. Raises RangeError if it is
    no such text, and the errors of `convert`."""
    match = _MEASURE.fullmatch(text[:200])
    if match is None or not unit:
        what = f'a number in {unit}, or a string such as "1.5 {unit}"' if unit else "a number"
        raise RangeError(f"{text!r} is not {what}")
    number = float(match[1])
    if match[2] == unit or same_unit(check_unit(match[2]), unit):
        return number
    converted = convert(number, match[2], unit)
    return float(f"{converted:.12g}")  # 80 degF: no digits that only the conversion has made
