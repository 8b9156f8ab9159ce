"""The options of a station: the keyword parameters of its machine, its application and the drivers of a wiring."""

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

from umo.objects import Compound
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
    """"machine", "application", or the type of the driver."""

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

    @property
    def is_plain(self) -> bool:
        """Whether it is of a type that a text can give."""
        item = _item(self.kind)
        return item is bool or item in TYPES or bool(_choices(item))

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
    """Those of the machine and of the application first; others of the same name are given the same value. Without
    `application` only those of the machine and the drivers."""
    found = {option.name: option for option in options_of_machine(station)}
    if application and station.main is not None:
        found = _of_function(station.main, "application", skip=1) | found
    for name, (driver, parameter) in driver_options(station.wiring(wiring)).items():
        if name not in found:
            found[name] = _option(name, parameter, parameter.annotation, driver)
    return list(found.values())


def options_of_machine(station: Station) -> list[Option]:
    """Those parameters of `machine` that a text can give."""
    return [option for option in _of_function(station.make, "machine", skip=0).values() if option.is_plain]


def parse(
    station: Station, wiring: str | None, arguments: Sequence[str], *, application: bool = True
) -> dict[str, Any]:
    """The values of a station's options; StationError for what it does not take."""
    options = options_of(station, wiring, application=application)
    given, others = _parse(station, options, arguments)
    if others:
        raise StationError(_unknown(station, options, others[0]))
    return given


def machine_of(station: Station, arguments: Sequence[str]) -> Compound:
    """The machine with these options; StationError for what it does not take."""
    machine, others = machine_and_words(station, arguments)
    if others:
        raise StationError(f"unexpected argument {others[0]!r}")
    return machine


def machine_and_words(station: Station, arguments: Sequence[str]) -> tuple[Compound, list[str]]:
    """The machine with the options that are among the arguments, and the other arguments. StationError if one of those
    is an option too."""
    options = options_of_machine(station)
    given, others = _parse(station, options, arguments)
    for argument in others:
        if argument.startswith("--"):
            raise StationError(_unknown(station, options, argument))
    return station.machine(**given), others


def _parse(station: Station, options: Sequence[Option], arguments: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    parser = _Parser(prog=station.name, add_help=False, allow_abbrev=False)
    for option in options:
        option.add_to(parser)
    given, others = parser.parse_known_args(list(arguments))
    return vars(given), others


def _unknown(station: Station, options: Sequence[Option], argument: str) -> str:
    flags = [option.flag for option in options]
    name = argument.partition("=")[0]
    near = did_you_mean(name.lstrip("-"), [flag.lstrip("-") for flag in flags])
    known = f"; it has: {', '.join(flags)}" if flags else ""
    return f"{station.name} has no option {name}{near}{known}"


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
