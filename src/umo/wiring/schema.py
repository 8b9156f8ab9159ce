"""The checks of a wiring by pydantic: one line of `[wire]`, and the options of a driver.

This module is imported when the first wiring is read, because pydantic takes longer to import than all of umo."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictInt, StrictStr, create_model

from umo.errors import DeclarationError
from umo.objects.linearization import Linearization, LookupTable, Polynomial
from umo.objects.thermocouple import Thermocouple
from umo.system.packages import station_of
from umo.wiring.json_values import as_plain
from umo.wiring.settings import above_0

Numeric = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class LinearizationTable(BaseModel):
    """`{ thermocouple = "K" }`, `{ polynomial = [c0, c1, ...] }`, with `domain = [from, to]` if it is needed, or `{
    table = [[inputs], [values]] }`; `{}` means that this circuit has no linearization."""

    model_config = ConfigDict(extra="forbid")

    thermocouple: Any = None
    polynomial: Any = None
    table: Any = None
    domain: Any = None

    @property
    def is_empty(self) -> bool:
        return not self.model_fields_set

    def made(self) -> Linearization:
        """Return the linearization of the table. Raises DeclarationError if the table is wrong."""
        given, kinds = self.model_fields_set, ("thermocouple", "polynomial", "table")
        if len(given & {*kinds}) != 1:
            raise DeclarationError(f"must have one of {', '.join(kinds)}")
        if "domain" in given and "polynomial" not in given:
            raise DeclarationError("domain is for a polynomial")
        if "thermocouple" in given:
            return Thermocouple(self.thermocouple)
        if "polynomial" in given:
            return Polynomial(self.polynomial, self.domain if "domain" in given else (-inf, inf))
        if not isinstance(self.table, list | tuple) or len(self.table) != 2:
            raise DeclarationError(f"table must be two lists, [[inputs], [values]], not {self.table!r}")
        return LookupTable(*self.table)


class Entry(BaseModel):
    """One line of `[wire]`: an object on a driver's channel, and the changes that this circuit makes to the declaration
    of the object."""

    model_config = ConfigDict(extra="forbid")

    driver: StrictStr
    channel: StrictStr | None = None
    """Text of the channel; the default is the object's path."""
    inverted: StrictBool | None = None
    """For binary objects: True if the electrical level is inverted."""
    resolution: Numeric | None = None
    zero_offset: Numeric | None = None
    linearization: LinearizationTable | None = None
    invalid_raws: list[StrictInt] | None = None
    """For digital sensors: raw values with which this circuit reports an invalid reading."""
    rollover: StrictBool | StrictInt | None = None
    """For digital sensors: the bits of a counter that rolls over; true means the bits of its channel, false means that
    it does not roll over."""
    minimum: Numeric | None = None
    maximum: Numeric | None = None
    start: StrictInt | None = None
    """For patterns (`umo.wiring.patterns`): `{}` in the channel stands for (start + n) * stride + offset."""
    stride: StrictInt | None = None
    offset: StrictInt | None = None
    period: Annotated[float | None, above_0()] = None
    """For the timer: the sampling period in s, or a string such as "1 ms"."""


def options_of(name: str, signature: Mapping[str, inspect.Parameter], given: dict[str, Any]) -> dict[str, Any]:
    """Check a driver's options against the annotations of its constructor, and return them. Raises ValidationError.

    Only values of types that TOML does not have are converted: a string to a Path, a list to a tuple. Pydantic converts
    JSON in this way, so it gets plain data as JSON.
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
    """Return the arguments of a driver's constructor from the wiring and from the options of the run, which take
    precedence. Raises ValidationError. A relative path in the wiring starts from its station, or from the folder of its
    file."""
    own = {key: value for key, value in (run or {}).items() if key in signature}

    def beside(value: Any) -> Any:
        return (station_of(Path(file)) or Path(file).parent) / value if isinstance(value, Path) else value

    options = options_of(cls.__name__, signature, {**given, **own})
    return {key: value if key in own else beside(value) for key, value in options.items()}
