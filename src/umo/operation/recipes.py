"""Recipes: typed sets of values with units and ranges, from TOML files or plain data. Each recipe is checked as a
whole."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from math import inf
from pathlib import Path
from typing import Any, TypeVar

from typing_extensions import dataclass_transform

from umo.errors import DeclarationError, Mistake, RecipeError, UmoError
from umo.operation.recipe_values import plain, range_of, value_for
from umo.signature import hints_of
from umo.text import did_you_mean
from umo.toml_lines import lines_of, toml_hint

MAX_FILE = 1_000_000
"""Largest size of a file of recipes, in bytes."""
NAME_FORM = re.compile(r"\w[\w .-]{0,59}")
"""Form of a recipe's name."""


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(dataclasses.field,))
@dataclasses.dataclass(frozen=True, kw_only=True)
class Recipe:
    """The base of a station's type of recipes. A subclass is a frozen dataclass, without a decorator.

        class Batch(Recipe):
            temperature: Annotated[float, Number("degC", 20.0, 95.0)]
            hold: Annotated[float, Number("s", 0.0, 3600.0)] = 60.0

    Types of fields: float, int, bool, str, an Enum, and tuples or lists of one of these. The range of a tuple applies
    to each of its numbers. A field with a default can be left out in a file. The default is checked, too.
    """

    name: str
    """The name: the stem of the recipe's file, or the name of its table."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Check the fields. Raises DeclarationError for a field with the name of a member that every recipe has."""
        super().__init_subclass__(**keywords)
        for name in vars(cls).get("__annotations__", {}):
            if name == "name" or hasattr(Recipe, name):
                raise DeclarationError(
                    f"{cls.__name__}.{name}: every recipe has a {name!r}; give the field another name"
                )
        dataclasses.dataclass(frozen=True, kw_only=True)(cls)

    @property
    def values(self) -> dict[str, Any]:
        """The values of the recipe without the name, as plain data."""
        return {each.name: plain(getattr(self, each.name)) for each in _fields(type(self))}

    @property
    def content(self) -> str:
        """The values of the recipe as JSON, in the form that a client sends."""
        return json.dumps(self.values, separators=(",", ":"), ensure_ascii=False)

    @property
    def hash(self) -> str:
        """The first 12 digits of the SHA-256 of the recipe's values. The hash does not depend on the order of the
        values or on the units in the file."""
        text = json.dumps(self.values, separators=(",", ":"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


R = TypeVar("R", bound=Recipe)


def recipe_of(
    kind: type[R], name: str, given: Mapping[str, Any], file: str = "recipe", text: str = "", *, units: bool = True
) -> R:
    """Return the recipe with these values. Raises RecipeError with all errors, and with line numbers if `text` is the
    content of the file. `units`: whether numbers may be strings with units."""
    mistakes: list[tuple[float, Mistake]] = []
    values: dict[str, Any] = {}
    hints = hints_of(kind)  # type: ignore[arg-type]
    fields = {each.name: each for each in _fields(kind)}
    lines = lines_of(text)

    def mistake(key: str, message: str) -> None:
        line = lines.get(f"{name}.{key}") or lines.get(key)
        mistakes.append((line or inf, Mistake(f"{file}:{line}" if line else file, key, message)))

    if not NAME_FORM.fullmatch(name):
        mistake("", f"{name[:60]!r} is not a name for a recipe")
    for key in given:
        if key not in fields:
            mistake(key, f"unknown key{did_you_mean(key, fields)}; known: {', '.join(fields)}")
    for key, field in fields.items():
        value = given[key] if key in given else _default(field)
        if value is dataclasses.MISSING:
            mistake(key, "is missing")
            continue
        try:
            values[key] = value_for(hints[key], value, units=units or key not in given)
        except UmoError as error:
            mistake(key, str(error) if key in given else f"its default: {error}")
    if mistakes:
        found = [each for _, each in sorted(mistakes, key=lambda each: each[0])]
        raise RecipeError(f"recipe {name} is refused", found)
    return kind(name=name, **values)


def recipe_from_content(kind: type[R], name: str, content: str) -> R:
    """Return the recipe with the values in a JSON string. Numbers are in the units of their fields. Raises
    RecipeError."""
    try:
        given = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise RecipeError(f"recipe {name} is refused: its content cannot be read: {error}") from None
    if not isinstance(given, dict):
        raise RecipeError(f"recipe {name} is refused: its content is not a table")
    return recipe_of(kind, name, given, units=False)


def read_recipes(kind: type[R], place: Path) -> dict[str, R]:
    """Return the recipes of a folder (one recipe in each `*.toml` file), or of one file (one recipe in each table), by
    name. Raises RecipeError with the errors of all recipes."""
    recipes: dict[str, R] = {}
    mistakes: list[Mistake] = []
    for file in sorted(place.glob("*.toml")) if place.is_dir() else [place]:
        try:
            text, data = _load(file)
            tables = {file.stem: data} if place.is_dir() else data
        except RecipeError as error:
            mistakes += error.mistakes
            continue
        for name, table in tables.items():
            try:
                if not isinstance(table, dict):
                    raise RecipeError("", [Mistake(str(file), name, f"must be a table, not {table!r}")])
                recipes[name] = recipe_of(kind, name, table, str(file), text)
            except RecipeError as error:
                mistakes += error.mistakes
    if not recipes and not mistakes:
        mistakes.append(Mistake(str(place), "", "has no recipes"))
    if mistakes:
        raise RecipeError("the recipes are refused", mistakes)
    return recipes


def _load(file: Path) -> tuple[str, dict[str, Any]]:
    text = ""
    try:
        with file.open("rb") as stream:
            raw = stream.read(MAX_FILE + 1)
        if len(raw) > MAX_FILE:
            raise ValueError(f"it has more than {MAX_FILE} bytes")
        text = raw.decode("utf-8-sig")  # Windows may begin it with a mark
        return text, tomllib.loads(text)
    except FileNotFoundError:
        message = "no such file"
    except (OSError, ValueError) as error:  # TOML and UTF-8 errors are ValueErrors
        message = f"cannot be read: {error}{toml_hint(str(error), text)}"
    except RecursionError:
        message = "cannot be read: it is nested too deeply"
    raise RecipeError("the recipes are refused", [Mistake(str(file), "", message)])


def describe_fields(kind: type[Recipe]) -> list[dict[str, Any]]:
    """Return name, unit and bounds of each value, as plain data."""
    hints = hints_of(kind)  # type: ignore[arg-type]
    limits = ((each.name, range_of(hints[each.name])) for each in _fields(kind))
    return [{"name": name, **({} if found is None else found.describe())} for name, found in limits]


def _default(field: dataclasses.Field[Any]) -> Any:
    """Return the default in the form that a file would contain; MISSING if there is no default."""
    if field.default_factory is not dataclasses.MISSING:
        return plain(field.default_factory())
    return plain(field.default)


def _fields(kind: type[Recipe]) -> Iterator[dataclasses.Field[Any]]:
    return (each for each in dataclasses.fields(kind) if each.name != "name")
