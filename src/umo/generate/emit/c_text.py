"""Numbers, names and comments as text of C."""

from __future__ import annotations

from collections.abc import Sequence
from math import isinf, isnan

import numpy as np

from umo.generate.translation import ControllerTarget

PER_LINE = 8
"""Numbers of a table per line."""


def real(number: float, target: ControllerTarget) -> str:
    """Return a number of the target's real type. C reads the text as the same number."""
    if isnan(number):
        return "(umo_real)NAN"
    if isinf(number):
        return "(umo_real)INFINITY" if number > 0 else "-(umo_real)INFINITY"
    if target.real == "double":
        return repr(float(number))
    text = f"{np.float32(number):.9g}"
    return f"{text}f" if any(mark in text for mark in ".e") else f"{text}.0f"


def real_or(number: float | None, otherwise: float, target: ControllerTarget) -> str:
    return real(otherwise if number is None else number, target)


def time_of(seconds: float | None, target: ControllerTarget) -> str:
    """Return a time in s; -1 for None."""
    return real_or(seconds, -1.0, target)


def truth(value: object) -> str:
    return "true" if value else "false"


def comment(text: str) -> str:
    """Return the text in a form that may stand in a comment."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").split())


def array(kind: str, name: str, numbers: Sequence[str]) -> str:
    """Return a constant array. If it is empty, it gets one element 0, because C has no empty arrays."""
    rows = [numbers[i : i + PER_LINE] for i in range(0, len(numbers), PER_LINE)] or [["0"]]
    body = "".join(f"    {', '.join(row)},\n" for row in rows)
    return f"static const UMO_FLASH {kind} {name}[] = {{\n{body}}};\n"
