"""Numbers of the control code that are set from outside: by the wiring's `[parameters]`, or tuned while it runs."""

from __future__ import annotations

from inspect import get_annotations
from typing import Any

from umo.errors import DeclarationError, RangeError
from umo.user_code import told_as


def as_declared(owner: Any, name: str, value: float) -> float:
    """The value for an attribute: an integer stays one. RangeError for a fraction where an int is annotated."""
    if not isinstance(getattr(owner, name), int):
        return float(value)
    if value == int(value):
        return int(value)
    if any(get_annotations(kind).get(name) in (int, "int") for kind in type(owner).__mro__):
        raise RangeError(f"{value!r} is not a whole number")
    return float(value)


def check_settings(owner: Any) -> None:
    """Ask a law about its settings after a change; DeclarationError or RangeError if they are not valid. An owner that
    has no `check_settings` accepts all."""
    check = getattr(owner, "check_settings", None)
    if callable(check):
        with told_as(DeclarationError, f"{type(owner).__name__}.check_settings failed"):
            check()
