"""The value of an object, a signal or a number in words, its unit, its quality. `about`: its description
(`umo.objects.description`)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from math import isfinite
from typing import Any

from umo.presentation.digits import NO_VALUE, digits_of, number_text

About = Mapping[str, Any]
SIGNS = "●▲◇◔✕"
"""Signs beside the words, where colour alone would not do."""
WORDS = ("good", "out of range", "unreferenced", "stale", "bad")
"""The qualities of a value (`umo.Quality`) in words, and why it is not good."""
WHY = (
    "",
    "beyond its range",
    "not homed",
    "the device failed: the last value is held",
    "the device failed, or was not read yet",
)
SHOWN_NAMES = {
    "percent": "%",
    "degC": "°C",
    "degree_Celsius": "°C",
    "degF": "°F",
    "degree_Fahrenheit": "°F",
    "deg": "°",
    "degree": "°",
    "delta_degC": "Δ°C",
    "ohm": "Ω",
    "kohm": "kΩ",
    "Mohm": "MΩ",
    **{f"u{unit}": f"µ{unit}" for unit in ("m", "s", "V", "A", "W", "N", "g", "F", "H", "J", "T", "L", "l", "rad")},
}
SILENT_UNITS = ("sampling_period", "dimensionless")
"""Units that say nothing where they are the whole unit."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NAME = re.compile(r"[^\W\d]\w*")
_POWER = re.compile(r"\s*(?:\*\*|\^)\s*\+?(-?\d+)(?![.\d])")
_TIMES = re.compile(r"\s*(?<!\*)\*(?!\*)\s*")


@lru_cache(maxsize=1024)
def shown_unit(unit: str) -> str:
    """A declared unit as in print, `mm/s²` for "mm/s**2", which can be typed; empty for one that says nothing."""
    if unit in SILENT_UNITS:
        return ""
    text = _POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), unit)
    return _NAME.sub(lambda name: SHOWN_NAMES.get(name[0], name[0]), _TIMES.sub("·", text))


def digits_in(about: About) -> int | None:
    """Digits after the point; None: it has no resolution."""
    resolution = about.get("resolution")
    return None if not resolution else digits_of(float(resolution), float(about.get("zero_offset", 0.0)))


def measure(value: float, unit: str, digits: int | None = None) -> str:
    """A number with its unit, for messages: `12.5 mm/s²`, `nan mm`."""
    text = number_text(value, digits) if isfinite(value) else str(float(value))
    return f"{text} {shown_unit(unit)}".rstrip()


def span(minimum: float | None, maximum: float | None, unit: str = "") -> str:
    """`0 to 10 V`, `up to 10 V`, `0 V or more`; the unit alone where there are no bounds."""
    if minimum is None:
        return shown_unit(unit) if maximum is None else f"up to {measure(maximum, unit)}"
    if maximum is None:
        return f"{measure(minimum, unit)} or more"
    return f"{number_text(minimum)} to {measure(maximum, unit)}"


def state_text(about: About, value: float) -> str:
    """The state of a binary object."""
    return str(about["one"] if value > 0.5 else about["zero"])


def named_state(about: About, value: float) -> str:
    """The name of a named value; the number where it has none."""
    return str(about["states"].get(str(int(value)), number_text(value)))


def value_text(about: About, *values: float) -> str:
    """The value with its unit, or the state; of a family the least to the greatest, or how many are in each state.
    Of named values the name of each."""
    known = [value for value in values if isfinite(value)]
    if not known:
        return NO_VALUE
    if "one" in about:
        ones = sum(value > 0.5 for value in known)
        if ones in (0, len(known)):
            return state_text(about, ones)
        return f"{ones} {about['one']}, {len(known) - ones} {about['zero']}"
    if "states" in about:
        names = dict.fromkeys(named_state(about, value) for value in known)
        return ", ".join(names)
    digits = digits_in(about)
    least, most = number_text(min(known), digits), number_text(max(known), digits)
    text = least if least == most else f"{least} to {most}"
    return f"{text} {shown_unit(about['unit'])}".rstrip()


def as_shown(about: About) -> dict[str, Any]:
    """The description for the page: with how its unit looks (`look`), the digits of its values, its range in words."""
    shown = dict(about)
    if "unit" in about:
        shown |= {"look": shown_unit(about["unit"]), "digits": digits_in(about)}
        shown["range"] = span(about.get("minimum"), about.get("maximum"))
    return shown


def file_form(about: About) -> str:
    """Format of a number in a file: an object's stands for one raw integer, others have all of their digits."""
    digits = 0 if "one" in about else digits_in(about)
    return "{}" if digits is None else f"{{:z.{digits}f}}"


def quality_text(quality: int, count: int | None = None) -> str:
    """`● good`, `◔ 3 stale`; `count`: of how many of several."""
    return " ".join(filter(None, [SIGNS[quality], "" if count is None else str(count), WORDS[quality]]))
