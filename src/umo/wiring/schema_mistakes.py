"""The mistakes that pydantic finds, in plain words: the key, its permitted values, and the nearest valid one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ValidationError

from umo.text import did_you_mean

PLAIN_MESSAGES = {
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "string_type": "must be a string",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "finite_number": "must be a finite number",
}
"""Messages of pydantic in plain words."""
UMO_ERROR = "umo"
"""The type of errors whose message comes from umo and contains the given value (`umo.wiring.settings`)."""
UNQUOTED_TYPES = ("int_type", "float_type", "bool_type")


def mistakes_of(
    error: ValidationError, known: list[str], types: Mapping[str, Any] | None = None
) -> Iterator[tuple[str, str]]:
    """Return (key, message) for each wrong key; a key in an inner table is written with dots. `types` are the types of
    the keys."""
    seen = set()
    for detail in error.errors():
        where = [str(part) for part in detail["loc"] if part != "[key]"]
        key = ".".join(where)
        if key in seen:
            continue
        seen.add(key)
        if detail["type"] == "extra_forbidden":
            names = known if len(where) == 1 else _keys_within(types or {}, where[:-1])
            all_names = f"; known: {', '.join(names)}" if names else ""
            yield key, f"unknown key{did_you_mean(where[-1], names)}{all_names}"
        elif detail["type"] == UMO_ERROR:
            yield key, detail["msg"]
        elif detail["type"] == "missing":
            yield key, "is missing"
        else:
            message = PLAIN_MESSAGES.get(detail["type"]) or f"{detail['msg'][0].lower()}{detail['msg'][1:]}"
            quoted = isinstance(detail["input"], str) and detail["type"] in UNQUOTED_TYPES
            yield key, f"{message}{', without quotes' * quoted}, not {detail['input']!r}"


def _keys_within(types: Mapping[str, Any], where: list[str]) -> list[str]:
    """Return the keys of a table in an option, found by the option's type, such as dict[str, SomeTypedDict] | None."""
    found = types.get(where[0])
    for name in where[1:]:
        found = types_of(found).get(name) or next(iter(get_args(_given(found))[-1:]), None)
    return list(types_of(found))


def types_of(annotation: Any) -> dict[str, Any]:
    """Return the type of each key of a model of pydantic, a TypedDict or a dataclass, or of the only model in a
    union."""
    if get_origin(annotation) in (UnionType, Union):
        return next(filter(None, map(types_of, get_args(annotation))), {})
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {key: each.annotation for key, each in annotation.model_fields.items()}
    return get_type_hints(annotation) if getattr(annotation, "__annotations__", None) else {}


def _given(annotation: Any) -> Any:
    """Return the type of an option without None."""
    is_union = get_origin(annotation) in (UnionType, Union)
    return next(each for each in get_args(annotation) if each is not NoneType) if is_union else annotation
