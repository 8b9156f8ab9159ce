"""The value of an object, a signal or a number in words. `about`: its description (`umo.objects.description`)."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from umo.presentation.digits import NO_VALUE, digits_of, number_text
from umo.presentation.unit_text import shown_unit

About = Mapping[str, Any]


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
    return (
        f"{measure(minimum, unit)} or more"
        if maximum is None
        else f"{number_text(minimum)} to {measure(maximum, unit)}"
    )


def state_text(about: About, value: float) -> str:
    """The state of a binary object."""
    return str(about["one"] if value > 0.5 else about["zero"])


def value_text(about: About, *values: float) -> str:
    """The value with its unit, or the state; of a family from the least to the greatest, or how many are in each
    state."""
    known = [value for value in values if isfinite(value)]
    if not known:
        return NO_VALUE
    if "one" in about:
        ones = sum(value > 0.5 for value in known)
        if ones in (0, len(known)):
            return state_text(about, ones)
        return f"{ones} {about['one']}, {len(known) - ones} {about['zero']}"
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
    """Format of a number in a file, without its unit: an object's stands for one raw integer; what
    has no resolution has all of its digits."""
    digits = 0 if "one" in about else digits_in(about)
    return "{}" if digits is None else f"{{:z.{digits}f}}"
