"""What pydantic checks of a wiring: one line of `[wire]`, and the options of a driver.

Imported with the first wiring that is read, as pydantic takes longer to import than all of umo.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictInt, StrictStr, ValidationError, create_model

from umo.system.packages import station_of
from umo.text import did_you_mean
from umo.wiring.json_values import as_plain

PLAIN_MESSAGES = {
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "string_type": "must be a text",
    "dict_type": "must be a table",
    "finite_number": "must be a finite number",
}
"""Messages of pydantic in plain words."""
UNQUOTED_TYPES = ("int_type", "float_type", "bool_type")
Numeric = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class Entry(BaseModel):
    """One line of `[wire]`: an object on a driver's channel, and what this circuit changes of its declaration."""

    model_config = ConfigDict(extra="forbid")

    driver: StrictStr
    channel: StrictStr | None = None
    """Default: the object's path."""
    inverted: StrictBool | None = None
    """Binary objects: the electrical level is inverted."""
    resolution: Numeric | None = None
    zero_offset: Numeric | None = None
    linearization: dict[str, Any] | None = None
    """Linearization such as `{ thermocouple = "K" }` (`umo.objects.linearization`); `{}`: this circuit has none."""
    invalid_raws: list[StrictInt] | None = None
    """Digital sensors: raw values with which this circuit reports an invalid reading."""
    rollover: StrictBool | StrictInt | None = None
    """Digital sensors: the bits of a counter that rolls over; true: those of its channel; false: it does not."""
    minimum: Numeric | None = None
    maximum: Numeric | None = None
    start: StrictInt | None = None
    """Patterns (`umo.wiring.patterns`): `{}` of the channel is (start + n) * stride + offset."""
    stride: StrictInt | None = None
    offset: StrictInt | None = None
    period: Any = None
    """The timer: the sampling period, s or a text such as "1 ms"."""


def options_of(name: str, signature: Mapping[str, inspect.Parameter], given: dict[str, Any]) -> dict[str, Any]:
    """A driver's options checked against its constructor's annotations; ValidationError.

    Values are not converted, except types that TOML does not have: a text to a Path, a list to a tuple.
    That is how pydantic takes JSON, so plain data is handed to it as JSON.
    """
    fields: dict[str, Any] = {
        key: (
            Any if p.annotation is inspect.Parameter.empty else p.annotation,
            ... if p.default is inspect.Parameter.empty else p.default,
        )
        for key, p in signature.items()
        if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)
    }
    config = ConfigDict(extra="forbid", arbitrary_types_allowed=True, strict=True)
    model = create_model(f"{name}Options", __config__=config, **fields)
    try:
        text = json.dumps(given, default=as_plain)
    except (TypeError, ValueError):  # a wiring that is a mapping may hold anything
        checked = model.model_validate(given)
    else:
        checked = model.model_validate_json(text)
    return {key: getattr(checked, key) for key in given}


def arguments_of(
    cls: Any,
    signature: Mapping[str, inspect.Parameter],
    given: Mapping[str, Any],
    file: str,
    run: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The arguments of a driver's constructor, of what the wiring gives and of the options of the run, which go first;
    ValidationError. A relative path that the wiring gives starts from its station, or from the folder of its file."""
    own = {key: value for key, value in (run or {}).items() if key in signature}

    def beside(value: Any) -> Any:
        return (station_of(Path(file)) or Path(file).parent) / value if isinstance(value, Path) else value

    options = options_of(cls.__name__, signature, {**given, **own})
    return {key: value if key in own else beside(value) for key, value in options.items()}


def mistakes_of(
    error: ValidationError, known: list[str], types: Mapping[str, inspect.Parameter] | None = None
) -> Iterator[tuple[str, str]]:
    """(key, message) for each key that is wrong; with dots where it is in a table within (`types`: of the options)."""
    seen = set()
    for detail in error.errors():
        where = [str(part) for part in detail["loc"]]
        key = ".".join(where)
        if key in seen:
            continue
        seen.add(key)
        if detail["type"] == "extra_forbidden":
            names = known if len(where) == 1 else _keys_within(types or {}, where[:-1])
            all_names = f"; known: {', '.join(names)}" if names else ""
            yield key, f"unknown key{did_you_mean(where[-1], names)}{all_names}"
        elif detail["type"] == "missing":
            yield key, "is missing"
        else:
            message = PLAIN_MESSAGES.get(detail["type"]) or f"{detail['msg'][0].lower()}{detail['msg'][1:]}"
            quoted = isinstance(detail["input"], str) and detail["type"] in UNQUOTED_TYPES
            yield key, f"{message}{', without quotes' * quoted}, not {detail['input']!r}"


def _keys_within(types: Mapping[str, inspect.Parameter], where: list[str]) -> list[str]:
    """The keys of a table in an option, by the option's annotation, such as dict[str, SomeTypedDict] | None."""
    found: Any = types[where[0]].annotation if where[0] in types else None
    for name in where[1:]:
        found = _fields(found).get(name) or next(iter(get_args(found)[-1:]), None)
    return list(_fields(found))


def _fields(annotation: Any) -> dict[str, Any]:
    """The fields of a TypedDict or a dataclass, or of the one in a union."""
    if get_origin(annotation) in (UnionType, Union):
        return next(filter(None, map(_fields, get_args(annotation))), {})
    return get_type_hints(annotation) if getattr(annotation, "__annotations__", None) else {}
