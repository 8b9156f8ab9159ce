"""Values that a user types."""

from __future__ import annotations

import re
from typing import Any

from umo.errors import RangeError
from umo.objects.units import convert

TRUE, FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


def number(name: str, text: str, unit: str) -> float:
    """A number, or a number with a unit such as "80 mm", in `unit`; RangeError if it is not one."""
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if match is None:
        raise RangeError(f"{name}: {text!r} is not a number{f' in {unit}' if unit else ''}")
    if re.match(r",\d", match[2]):
        raise RangeError(f"{name}: {text!r} is not a number; write {text.strip().replace(',', '.', 1)}")
    return convert(float(match[1]), match[2] or unit, unit)


def argument(path: str, about: dict[str, Any], text: str) -> Any:
    """Of an action, as its declaration describes it."""
    name, kind = f"{path}: {about['name']}", about["kind"]
    if kind in ("number", "integer"):
        return number(name, text, about["unit"])
    if kind == "bool":
        if text.lower() not in (*TRUE, *FALSE):
            raise RangeError(f"{name}: {text!r} is not true or false")
        return text.lower() in TRUE
    return text
