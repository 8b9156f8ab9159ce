"""Units as in print: `mm/s²` for "mm/s**2". What is shown is a unit that can be typed."""

from __future__ import annotations

import re
from functools import lru_cache

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
    """A declared unit as it is shown; empty for one that says nothing."""
    if unit in SILENT_UNITS:
        return ""
    text = _POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), unit)
    return _NAME.sub(lambda name: SHOWN_NAMES.get(name[0], name[0]), _TIMES.sub("·", text))
