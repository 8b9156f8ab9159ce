"""Signatures and annotations of the user's functions and classes, and the types whose values can be given as
strings."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from functools import cache, partial
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

JSON = (int, float, str, bool, inspect.Parameter.empty)
"""The types whose values need no conversion from JSON, and `empty` for a parameter without a known type, whose value is
given as a string."""


def signature_of(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return all parameters by name, each annotated with the type of its values: the evaluated annotation. If the
    annotation cannot be evaluated (a type that is imported for type checkers only) or is missing, the type of the
    default is used. The result is empty for a function without a signature."""
    try:
        found = inspect.signature(function).parameters
    except (TypeError, ValueError):
        return {}
    names = _namespace(function)
    return {name: _typed(each, names) for name, each in found.items()}


def parameters_of(function: Callable[..., Any], skip: int = 0) -> dict[str, inspect.Parameter]:
    """Return the parameters that can be given by name, without the first `skip`."""
    found = list(signature_of(function).values())[skip:]
    return {each.name: each for each in found if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)}


@cache
def hints_of(cls: Any) -> dict[str, Any]:
    """Return the annotated type of each attribute of a class and of its bases, with the additions of `Annotated`. The
    type is a string if it cannot be evaluated (a class declared inside a function, a type that is imported for type
    checkers only)."""
    hints: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        names = vars(sys.modules.get(base.__module__, object))
        try:
            own = inspect.get_annotations(base)
        except NameError:  # Python 3.14 evaluates them here
            continue
        hints |= {name: evaluated(each, names, vars(base), extras=True) for name, each in own.items()}
    return hints


def evaluated(annotation: Any, names: Any, more: Any = None, extras: bool = False) -> Any:
    """Return the type of an annotation; with `extras`, including the additions of `Annotated`. If it cannot be
    evaluated, return the annotation itself."""
    holder = SimpleNamespace(__annotations__={"it": annotation})
    try:
        return get_type_hints(holder, dict(names), dict(more or {}), include_extras=extras)["it"]
    except Exception:  # an annotation may be anything
        return annotation


def without_none(kind: Any) -> Any:
    """Return the type without None: int for `int | None`; for other unions the first type."""
    if get_origin(kind) in (Union, UnionType):
        return next((each for each in get_args(kind) if each is not NoneType), str)
    return kind


def item_of(kind: Any) -> Any:
    """Return the type of the values of a sequence; any other type is returned unchanged."""
    kind = without_none(kind)
    origin = get_origin(kind)
    if isinstance(origin, type) and issubclass(origin, Sequence) and get_args(kind):
        return get_args(kind)[0]
    return kind


def choices_of(kind: Any) -> list[Any]:
    """Return the values of a Literal or an Enum; empty for any other type."""
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return [each.value for each in kind]
    return []


def is_plain(kind: Any) -> bool:
    """Return True if values of this type can be given as strings."""
    item = item_of(kind)
    choices = choices_of(item)
    return item in (*JSON, Path) or (bool(choices) and all(isinstance(choice, int | float | str) for choice in choices))


def is_converted(kind: Any) -> bool:
    """Return True if values of this type are converted from JSON (an Enum, a Path, a tuple), or only some values are
    allowed (a Literal)."""
    return is_plain(kind) and without_none(kind) not in JSON


def _typed(parameter: inspect.Parameter, names: Mapping[str, Any]) -> inspect.Parameter:
    kind: Any = parameter.annotation
    if kind is not parameter.empty:
        kind = Any if isinstance(kind := evaluated(kind, names), str) else kind
    default = None if parameter.default is parameter.empty else parameter.default
    if default is not None and kind in (Any, parameter.empty):
        kind = Path if isinstance(default, Path) else type(default)
    return parameter.replace(annotation=kind)


def _namespace(function: Any) -> Mapping[str, Any]:
    """Return the global names of the module that defines a function, a class, a partial or a callable object."""
    while isinstance(function, partial):
        function = function.func
    if isinstance(function, type):
        function = function.__init__  # type: ignore[misc]
    elif not inspect.isroutine(function):
        function = type(function).__call__
    names: Mapping[str, Any] = getattr(inspect.unwrap(function), "__globals__", {})
    return names
