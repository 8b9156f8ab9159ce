"""The options of a station: the keyword parameters of its machine, of its application, and of the drivers of a
wiring."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from umo.drivers import Driver, registry
from umo.errors import OptionError
from umo.objects import Compound
from umo.process.station import Station
from umo.signature import choices_of, is_plain, item_of, parameters_of, without_none
from umo.text import did_you_mean, options_in, shown_path
from umo.wiring import driver_options
from umo.wiring.parameters import arguments_for, flag
from umo_command.shared import command_that_runs, plain

TYPES = {int: "INTEGER", float: "NUMBER", str: "TEXT", Path: "PATH"}
METAVAR_WIDTH = 24
"""Largest number of characters of a line of choices in the help."""
NUMBERS: dict[Any, click.ParamType[Any]] = {int: click.INT, float: click.FLOAT}


@dataclass(frozen=True)
class Option:
    name: str
    kind: Any
    """The type: int, float, str, bool or Path, a Literal or Enum, or a sequence of one of these."""
    default: Any
    taker: str
    """The part that takes the option: "machine", "application", or the type of the driver."""
    required: bool = False
    about: str = ""
    """The line about the option in the section "Options:" of the docstring of the function or class that takes it."""

    @property
    def flag(self) -> str:
        return flag(self.name)

    @property
    def metavar(self) -> str:
        """The placeholder for the value of the option in the help."""
        if self.kind is bool:
            return ""
        item = item_of(self.kind)
        return "|".join(map(str, choices)) if (choices := choices_of(item)) else TYPES.get(item, "TEXT")

    @property
    def is_repeated(self) -> bool:
        return item_of(self.kind) is not self.kind

    @property
    def parameter(self) -> click.Option:
        item = item_of(self.kind)
        if item is bool:
            return click.Option([self.name, f"{self.flag}/{flag('no_' + self.name)}"], default=None)
        kind = click.Choice(choices) if (choices := choices_of(item)) else NUMBERS.get(item, click.STRING)
        return click.Option([self.name, self.flag], type=kind, multiple=self.is_repeated)


def options_of(station: Station, wiring: str | None, *, application: bool = True) -> list[Option]:
    """Return the options of a station, first those of the machine and of the application. Further options of the same
    name get the same value. Without `application`, return only the options of the machine and of the drivers."""
    found = {option.name: option for option in options_of_machine(station)}
    if application and station.main is not None:
        found = {option.name: option for option in _of_function(station.main, "application", skip=1)} | found
    for name, (driver, parameter) in driver_options(station.wiring(wiring)).items():
        if name not in found and is_plain(parameter.annotation):
            found[name] = _option(parameter, driver, registry.find(driver))
    return list(found.values())


def options_of_machine(station: Station) -> list[Option]:
    """Return the parameters of `machine` whose value can be given as a string."""
    return _of_function(station.make, "machine")


def machine_with(station: Station, given: Mapping[str, Any]) -> Compound:
    """Return the machine, created with those options that its function takes."""
    return station.machine(**arguments_for(station.make, "machine", given))


def parse(
    station: Station,
    wiring: str | None,
    arguments: Sequence[str],
    command: Sequence[str] = (),
    *,
    application: bool = True,
) -> dict[str, Any]:
    """Return the values of a station's options. Raises OptionError for unknown options. `command`: the options of the
    command itself. An error may suggest one of them."""
    options = options_of(station, wiring, application=application)
    return values_of(station.name, options, arguments, command)


def options_of_driver(cls: type[Driver], name: str) -> list[Option]:
    """Return the options of a driver whose value can be given as a string."""
    return [_option(each, name, cls) for each in parameters_of(cls).values() if is_plain(each.annotation)]


def values_of(
    name: str, options: Sequence[Option], arguments: Sequence[str], command: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the values of these options of a station or a driver. Raises OptionError for unknown options."""
    given, others = _parse(name, options, arguments)
    if others:
        raise OptionError(_unknown(name, options, others[0], command))
    return given


def machine_of(station: Station, arguments: Sequence[str]) -> Compound:
    """Return the machine with these options. Raises OptionError for unknown options."""
    machine, others = machine_and_words(station, arguments)
    if others:
        raise OptionError(_unknown(station.name, (), others[0]))
    return machine


def machine_and_words(station: Station, arguments: Sequence[str]) -> tuple[Compound, list[str]]:
    """Return the machine, created with the options among the arguments, and the other arguments. Raises OptionError if
    one of the other arguments is an option."""
    options = options_of_machine(station)
    given, others = _parse(station.name, options, arguments)
    for argument in others:
        if argument.startswith("--"):
            raise OptionError(_unknown(station.name, options, argument))
    return machine_with(station, given), others


def _parse(name: str, options: Sequence[Option], arguments: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    settings = {"ignore_unknown_options": True, "allow_extra_args": True}
    command = click.Command(name, settings, params=[option.parameter for option in options], add_help_option=False)
    try:
        context = command.make_context(name, list(arguments))
    except click.ClickException as error:
        raise OptionError(f"{name}: {plain(error.format_message())}{_nearest(error)}") from None
    source, found = context.get_parameter_source, context.params.items()
    given = {key: value for key, value in found if source(key) is ParameterSource.COMMANDLINE}
    return {key: [*value] if isinstance(value, tuple) else value for key, value in given.items()}, context.args


def _nearest(error: click.ClickException) -> str:
    """Return the choice of an option that is nearest to the given value."""
    choice = getattr(getattr(error, "param", None), "type", None)
    given = re.search(r"'([^']*)' is not one of", error.format_message())
    return did_you_mean(given[1], map(str, choice.choices)) if given and isinstance(choice, click.Choice) else ""


def _unknown(taker: str, options: Sequence[Option], argument: str, command: Sequence[str] = ()) -> str:
    """Return the message for an argument that nobody takes. `command`: the options of the command itself; without them,
    those of the command that runs."""
    where, of_where = command_that_runs()
    command = command or of_where
    if not argument.startswith("-"):
        return f"{taker}: unexpected argument {argument!r}"
    flags = [option.flag for option in options]
    name = argument.partition("=")[0]
    near = did_you_mean(name.lstrip("-"), [flag.lstrip("-") for flag in (*flags, *command)])
    known = f"; it has: {', '.join(flags)}" if flags else ""
    if where and not near:
        known += f"; `{where} --help` lists the options of the command"
    return f"{taker} has no option {name}{near}{known}"


def help_panel(station: Station, wiring: str | None, *, application: bool = True) -> Panel:
    """Return a table of a station's options, in the form that `--help` uses for those of umo."""
    table = Table.grid(padding=(0, 2))
    for _ in range(4):
        table.add_column(overflow="fold")
    for option in options_of(station, wiring, application=application):
        shown = f"[default: {_shown(option.default)}]" if option.default not in (None, ()) else ""
        shown = "[required]" if option.required else shown
        repeated = "may be repeated" if option.is_repeated else ""
        told = "; ".join(filter(None, (option.about.rstrip("."), repeated)))
        about = "  ".join(filter(None, (told, shown)))
        table.add_row(*map(Text, (option.flag, _in_lines(option.metavar), option.taker, about)))
    files = Text(f"files: {shown_path(str(station.path))}")
    title = f"Options of {station.name}"
    return Panel(Group(table, files), title=title, title_align="left", border_style="dim")


def _in_lines(metavar: str) -> str:
    """Return the choices of an option in lines of at most `METAVAR_WIDTH` characters."""
    lines = [""]
    for word in re.findall(r"[^|]+\|?", metavar):
        if lines[-1] and len(lines[-1] + word) > METAVAR_WIDTH:
            lines.append("")
        lines[-1] += word
    return "\n".join(lines)


def _shown(default: Any) -> str:
    """Return a default in the form in which the command line takes it."""
    if isinstance(default, tuple | list):
        return ", ".join(map(_shown, default))
    return str(default.value if isinstance(default, Enum) else default)


def _of_function(function: Any, taker: str, skip: int = 0) -> list[Option]:
    """Return the parameters whose values can be given as text."""
    found = parameters_of(function, skip).values()
    return [
        replace(_option(each, taker, function), required=each.default is each.empty)
        for each in found
        if is_plain(each.annotation)
    ]


def _option(parameter: inspect.Parameter, taker: str, described: Any) -> Option:
    default = None if parameter.default is parameter.empty else parameter.default
    about = options_in(described.__doc__ or "").get(parameter.name, "")
    return Option(parameter.name, without_none(parameter.annotation), default, taker, about=about)
