"""The options of a station: the keyword parameters of its application and of the drivers of a wiring."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, NoReturn, Union, get_args, get_origin, get_type_hints

from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from umo.process.station import Station, StationError
from umo.text import did_you_mean
from umo.wiring import driver_options

TYPES = {int: "INTEGER", float: "NUMBER", str: "TEXT", Path: "PATH"}


@dataclass(frozen=True)
class Option:
    """One option of a station."""

    name: str
    kind: Any
    """Its type: int, float, str, bool, Path; a Literal or Enum; a sequence of one of these."""
    default: Any
    taker: str
    """"application", or the type of the driver."""

    @property
    def flag(self) -> str:
        return f"--{self.name.replace('_', '-')}"

    @property
    def metavar(self) -> str:
        """What the help shows for its value."""
        if self.kind is bool:
            return ""
        item = _item(self.kind)
        return "|".join(map(str, choices)) if (choices := _choices(item)) else TYPES.get(item, "TEXT")

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        item = _item(self.kind)
        how: dict[str, Any] = {"dest": self.name, "default": argparse.SUPPRESS}
        if item is bool:
            parser.add_argument(self.flag, action=argparse.BooleanOptionalAction, **how)
            return
        if item is not self.kind:
            how["action"] = "append"
        choices = _choices(item)
        parser.add_argument(self.flag, type=item if item in (int, float) else str, choices=choices or None, **how)


def options_of(station: Station, wiring: str | None, *, application: bool = True) -> list[Option]:
    """Those of the application first; a driver's of the same name is given the same value. Without `application` only
    those of the drivers."""
    main = station.main if application else None
    found = {} if main is None else _of_function(main, "application", skip=1)
    for name, (driver, parameter) in driver_options(station.wiring(wiring)).items():
        if name not in found:
            found[name] = _option(name, parameter, parameter.annotation, driver)
    return list(found.values())


def parse(
    station: Station, wiring: str | None, arguments: Sequence[str], *, application: bool = True
) -> dict[str, Any]:
    """The values of a station's options; StationError for what it does not take."""
    options = options_of(station, wiring, application=application)
    flags = [option.flag for option in options]
    parser = _Parser(prog=station.name, add_help=False, allow_abbrev=False)
    for option in options:
        option.add_to(parser)
    given, unknown = parser.parse_known_args(list(arguments))
    if unknown:
        name = unknown[0].partition("=")[0]
        near = did_you_mean(name.lstrip("-"), [flag.lstrip("-") for flag in flags])
        known = f"; it has: {', '.join(flags)}" if flags else ""
        raise StationError(f"{station.name} has no option {name}{near}{known}")
    return vars(given)


def help_panel(station: Station, wiring: str | None, *, application: bool = True) -> Panel:
    """A table of a station's options, as `--help` shows those of umo."""
    table = Table.grid(padding=(0, 2))
    for option in options_of(station, wiring, application=application):
        default = option.default.value if isinstance(option.default, Enum) else option.default
        shown = "" if default is None or default == () else f"[default: {default}]"
        table.add_row(*map(Text, (option.flag, option.metavar, option.taker, shown)))
    return Panel(table, title=f"Options of {station.name}", title_align="left", border_style="dim")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise StationError(f"{self.prog}: {message}")


def _of_function(function: Any, taker: str, skip: int) -> dict[str, Option]:
    parameters = list(inspect.signature(function).parameters.values())[skip:]
    named = [each for each in parameters if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]
    try:
        hints = get_type_hints(function)
    except NameError:  # of a type that is imported for type checkers only
        hints = {}
    return {each.name: _option(each.name, each, hints.get(each.name, Any), taker) for each in named}


def _option(name: str, parameter: inspect.Parameter, kind: Any, taker: str) -> Option:
    default = None if parameter.default is parameter.empty else parameter.default
    return Option(name, _without_none(kind), default, taker)


def _without_none(kind: Any) -> Any:
    """`int | None` is int; of other unions the first."""
    if get_origin(kind) in (Union, UnionType):
        return next((each for each in get_args(kind) if each is not NoneType), str)
    return kind


def _item(kind: Any) -> Any:
    """The type of one value of a sequence; the type itself of anything else."""
    origin = get_origin(kind)
    if isinstance(origin, type) and issubclass(origin, Sequence) and get_args(kind):
        return get_args(kind)[0]
    return kind


def _choices(kind: Any) -> list[Any]:
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return [each.value for each in kind]
    return []
