"""Tables of settings in a wiring, and in the files of a user (fleet, roles, users of faces).

A table is a dataclass. Its annotations describe the permitted values of each key, `Annotated[float, a_time(1.0)]`;
pydantic checks them, as it checks a wiring. A mistake is reported like a mistake in a wiring, with file, line, key, and
the nearest valid value.
"""

from __future__ import annotations

import dataclasses
import os
import stat
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

from umo.byte_size import byte_size
from umo.duration import seconds, seconds_of_setting
from umo.errors import DeclarationError, Mistake, OptionError, UmoError
from umo.signature import hints_of
from umo.text import cut_repr, did_you_mean
from umo.toml_lines import line_of, lines_of, toml_hint

S = TypeVar("S")
COMMAND_LINE = "the command line"
"""The name in place of a file for a mistake that is not in a file."""


class SettingsError(OptionError):
    """A table of settings is wrong; `mistakes` lists all mistakes, with file and line if they are known."""

    def __init__(self, mistakes: Sequence[Mistake]) -> None:
        super().__init__("; ".join(map(str, mistakes)))
        self.mistakes = tuple(mistakes)


# What a key may be ---------------------------------------------------------------------------------------


class TakenBy:
    """The conversion of a value: a function that returns the converted value, or raises one of umo's errors. Used in
    `Annotated`."""

    def __init__(self, take: Callable[[Any], Any]) -> None:
        self.take = take

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import PydanticCustomError, core_schema

        from umo.wiring.schema_mistakes import UMO_ERROR

        def told(value: Any) -> Any:
            try:
                return self.take(value)
            except UmoError as error:
                raise PydanticCustomError(UMO_ERROR, "{text}", {"text": str(error)}) from None

        return core_schema.no_info_plain_validator_function(told)


def a_time(least: float = 0.0) -> TakenBy:
    """Return the conversion of a time in s, given as a number of s or a string such as "20 ms"."""

    def take(value: Any) -> float:
        if (found := seconds(value)) < least:
            raise DeclarationError(f"{value!r} is less than {least:g} s")
        return found

    return TakenBy(take)


def above_0() -> TakenBy:
    """Return the conversion of a time in s above 0; a whole number from 1 on must have a unit
    (`seconds_of_setting`)."""

    def take(value: Any) -> float:
        if (found := seconds_of_setting(value)) == 0:
            raise DeclarationError("is 0")
        return found

    return TakenBy(take)


def a_size(least: int) -> TakenBy:
    """Return the conversion of a size in bytes, given as a string such as "200 MB"."""
    return TakenBy(lambda value: byte_size(value, least))


def a_number(low: float, high: float, what: str = "a number") -> TakenBy:
    """Return the conversion of a number within these limits."""

    def take(value: Any) -> float:
        if not is_number(value) or not low <= value <= high:
            limits = f"from {low:g} to {high:g}" if isfinite(high) else f"from {low:g} on"
            raise DeclarationError(f"must be {what} {limits}, not {cut_repr(value)}")
        return float(value)

    return TakenBy(take)


def a_whole(low: int, high: float = inf) -> TakenBy:
    """Return the conversion of a whole number within these limits."""

    def take(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            limits = f"from {low} to {high}" if isfinite(high) else f"from {low} on"
            raise DeclarationError(f"must be a whole number {limits}, not {cut_repr(value)}")
        return value

    return TakenBy(take)


def one_of(*choices: str) -> TakenBy:
    """Return the conversion that accepts one of these strings."""

    def take(value: Any) -> str:
        if value not in choices:
            known = ", ".join(choices)
            raise DeclarationError(f"must be one of {known}, not {cut_repr(value)}{did_you_mean(str(value), choices)}")
        return str(value)

    return TakenBy(take)


def a_text(what: str) -> TakenBy:
    """Return the conversion of a string that is not blank, such as a name or a path."""

    def take(value: Any) -> str:
        if not isinstance(value, str) or not value.strip():
            raise DeclarationError(f"must be {what}, not {cut_repr(value)}")
        return value

    return TakenBy(take)


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


# Reading -----------------------------------------------------------------------------------------------


def values_of(kind: Any, table: Mapping[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Return the valid values by key, and (key, message) of each mistake."""
    from pydantic import ValidationError

    from umo.wiring.schema_mistakes import mistakes_of

    model = _model(kind)
    given = dict(table)
    mistakes: list[tuple[str, str]] = []
    while True:
        try:
            checked = model.model_validate(given)
        except ValidationError as error:
            mistakes += mistakes_of(error, list(model.model_fields), hints_of(kind))
            wrong = {str(detail["loc"][0]) for detail in error.errors()}
            if not (rest := {key: value for key, value in given.items() if key not in wrong}) or rest == given:
                return {}, mistakes
            given = rest
        else:
            return {key: getattr(checked, key) for key in given}, mistakes


def settings_of(
    kind: type[S], table: Mapping[str, Any], file: str, section: str = "", lines: Mapping[str, int] | None = None
) -> S:
    """Return the settings of a table as the dataclass. Raises SettingsError with all mistakes. `file`: the file of the
    table, which is read to find the lines of the keys if they are not given; `section`: the name of the table in the
    file."""
    values, found = values_of(kind, table)
    if found:
        raise refusal(found, file, section, lines)
    return kind(**values)


def changed(given: S, changes: Mapping[str, Any] | None, section: str = "") -> S:
    """Return the settings, in which the settings of a command line that are not None replace the given ones. Raises
    SettingsError."""
    wanted = {key: value for key, value in (changes or {}).items() if value is not None}
    found: Any = settings_of(type(given), wanted, COMMAND_LINE, section)
    settings: Any = given
    return cast(S, dataclasses.replace(settings, **{key: getattr(found, key) for key in wanted}))


def refusal(
    found: Iterable[tuple[str, str]], file: str, section: str = "", lines: Mapping[str, int] | None = None
) -> SettingsError:
    """Return the error for these (key, message) pairs in a section of a file."""
    known = _lines_of(Path(file)) if lines is None else lines
    return SettingsError([_mistake(file, f"{section}.{key}".strip("."), text, known) for key, text in found])


def _mistake(file: str, key: str, text: str, lines: Mapping[str, int]) -> Mistake:
    line = line_of(key, lines)
    return Mistake(file if line is None else f"{file}:{line}", key, text)


def _lines_of(file: Path) -> Mapping[str, int]:
    try:
        return lines_of(file.read_text(encoding="utf-8-sig")) if file.is_file() else {}
    except (OSError, ValueError):
        return {}


def read_settings(kind: type[S], file: Path, most: int = 1 << 20, secret: bool = False) -> S | None:
    """Return the settings of a TOML file, or None if there is no file. Raises OptionError for a mistake, and for a file
    that cannot be read, has more than `most` bytes, or is a `secret` that other users may write."""
    try:
        with open(file, "rb", opener=_without_waiting) as stream:
            if secret and os.fstat(stream.fileno()).st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                raise OptionError(f"{file}: other users can write the file: chmod 600")
            data = stream.read(most + 1)
    except FileNotFoundError:
        if file.is_symlink():  # a link that leads nowhere
            raise OptionError(f"{file} is a link to a file that does not exist") from None
        return None
    except OSError as error:
        raise OptionError(f"{file} cannot be read: {error.strerror}") from None
    if len(data) > most:
        raise OptionError(f"{file} is longer than {most} bytes")
    return settings_in(kind, data, file)


def settings_in(kind: type[S], data: bytes, file: Path) -> S:
    """Return the settings in the present or future content of a file. Raises OptionError."""
    text = ""
    try:
        text = data.decode("utf-8-sig")  # Windows may begin it with a mark
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise OptionError(f"{file}: {error}{toml_hint(str(error), text)}") from None
    return settings_of(kind, table, str(file), lines=lines_of(text))


def _without_waiting(path: str, flags: int) -> int:
    """Open a file without waiting: a pipe in place of the file does not block."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


@cache
def _model(kind: Any) -> Any:
    """Return the model of pydantic for a dataclass."""
    from pydantic import ConfigDict, create_model

    hints = hints_of(kind)
    fields: dict[str, Any] = {}
    for each in dataclasses.fields(kind):
        required = each.default is dataclasses.MISSING and each.default_factory is dataclasses.MISSING
        fields[each.name] = (_checked(hints[each.name]), ... if required else None)
    config = ConfigDict(extra="forbid", strict=True, arbitrary_types_allowed=True)
    return create_model(kind.__name__, __config__=config, **fields)


def _checked(hint: Any) -> Any:
    """Return the type with which pydantic checks a key. A table within a table is a dataclass, too."""
    if not (isinstance(hint, type) and dataclasses.is_dataclass(hint)):
        return hint
    from pydantic import AfterValidator

    def made(model: Any) -> Any:
        return hint(**{key: getattr(model, key) for key in model.model_fields_set})

    return Annotated[_model(hint), AfterValidator(made)]


def names_of(kind: Any) -> Sequence[str]:
    """Return the keys of a table."""
    return [each.name for each in dataclasses.fields(kind)]
