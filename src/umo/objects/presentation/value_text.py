"""Units, numbers with a unit, ranges and qualities as text."""

from __future__ import annotations

import re
from functools import lru_cache
from math import isfinite

from umo.digits import number_text

SIGNS = "●▲◇◔✕"
"""The signs of the qualities, shown next to the words because colour alone is not sufficient."""
WORDS = ("good", "out of range", "unreferenced", "stale", "bad")
"""The qualities of a value (`umo.Quality`) as text, and why the value is not good."""
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
"""The units that are not shown if they stand alone."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NAME = re.compile(r"[^\W\d]\w*")
_POWER = re.compile(r"\s*(?:\*\*|\^)\s*\+?(-?\d+)(?![.\d])")
_TIMES = re.compile(r"\s*(?<!\*)\*(?!\*)\s*")


@lru_cache(maxsize=1024)
def shown_unit(unit: str) -> str:
    """Return a declared unit in its printed form, such as `mm/s²` for "mm/s**2"; empty for a unit that is not shown."""
    if unit in SILENT_UNITS:
        return ""
    text = _POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), unit)
    return _NAME.sub(lambda name: SHOWN_NAMES.get(name[0], name[0]), _TIMES.sub("·", text))


def measure(value: float, unit: str, digits: int | None = None) -> str:
    """Return a number with its unit, for messages: `12.5 mm/s²`, `nan mm`."""
    text = number_text(value, digits) if isfinite(value) else str(float(value))
    return f"{text} {shown_unit(unit)}".rstrip()


def span(minimum: float | None, maximum: float | None, unit: str = "") -> str:
    """Return a range as text, such as `0 to 10 V`, `up to 10 V` or `0 V or more`; only the unit if there are no
    bounds."""
    if minimum is None:
        return shown_unit(unit) if maximum is None else f"up to {measure(maximum, unit)}"
    if maximum is None:
        return f"{measure(minimum, unit)} or more"
    return f"{number_text(minimum)} to {measure(maximum, unit)}"


def quality_text(quality: int, count: int | None = None) -> str:
    """Return a quality as text, such as `● good` or `◔ 3 stale`. `count`: the number of objects with this quality among
    several."""
    return " ".join(filter(None, [SIGNS[quality], "" if count is None else str(count), WORDS[quality]]))
