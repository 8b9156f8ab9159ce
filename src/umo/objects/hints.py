"""The annotations of a class, evaluated."""

from __future__ import annotations

import inspect
import sys
from types import SimpleNamespace
from typing import Any, get_type_hints


def hints_of(cls: Any) -> dict[str, Any]:
    """The annotated type of each attribute of a class and of its bases, with what `Annotated` adds; a text where it
    cannot be evaluated (a class declared inside a function, a type that is imported for type checkers only)."""
    hints: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        names = vars(sys.modules.get(base.__module__, object))
        hints |= {name: evaluated(each, names, vars(base)) for name, each in inspect.get_annotations(base).items()}
    return hints


def evaluated(annotation: Any, names: Any, more: Any = None) -> Any:
    """The type; the annotation as it is if it cannot be evaluated."""
    holder = SimpleNamespace(__annotations__={"it": annotation})
    try:
        return get_type_hints(holder, dict(names), dict(more or {}), include_extras=True)["it"]
    except Exception:  # an annotation may be anything
        return annotation
