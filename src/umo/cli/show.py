"""`umo check`, `umo drivers`."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.text import Text
from rich.tree import Tree

from umo.drivers import Driver, registry
from umo.errors import ChannelError, Fault, WiringError
from umo.objects.interlock import interlocks_of
from umo.process.station import Station
from umo.system.packages import package_of
from umo.wiring import check, resolve

from .console import err, out
from .station_options import machine_of

FUNCTIONS = [name for name, value in vars(Driver).items() if inspect.isfunction(value)]
"""Of a driver, in the order of the contract."""


def check_station(station: Station, wiring: str | None, arguments: Sequence[str] = ()) -> int:
    """Print every fault and return 2, or one line on what is wired and return 0."""
    file = station.wiring(wiring)
    machine = machine_of(station, arguments)
    station.module("application")  # a wiring may be right and the application not import
    interlocks_of(machine)
    faults = check(machine, file)
    if reported(faults):
        return 2
    wired = resolve(machine, file)
    period = "no timer" if wired.period is None else f"period {wired.period * 1e3:g} ms"
    name = file or "everything simulated"
    out.print(f"ok: {name}: {len(wired.wires)} objects on {len(wired.drivers)} drivers, {period}", soft_wrap=True)
    return 0


def reported(faults: list[Fault]) -> int:
    """Print every fault; how many there are."""
    for fault in faults:
        err.print(str(fault), soft_wrap=True)
    return len(faults)


def label(*words: tuple[str, str]) -> Text:
    """Words, each with its style, two blanks apart."""
    return Text("  ").join(Text(word, style) for word, style in words)


def show_drivers(name: str | None = None) -> None:
    """Every registered driver, or the one of this name: its options and channels, or why it cannot be imported."""
    if name is not None:
        cls, tree = _find(name), Tree(f"driver {name}")
        own = [each for each in FUNCTIONS if getattr(cls, each) is not getattr(Driver, each)]
        _describe(tree, cls.__name__, cls).add(f"functions of its own: {', '.join(own)}")
        out.print(tree)
        return
    tree = Tree("drivers; a wiring may also name module:Class")
    for known in registry.known():
        try:
            _describe(tree, known, registry.find(known))
        except WiringError as error:
            tree.add(label((known, "bold"), (str(error), "red")))
    out.print(tree)


def _find(name: str) -> type[Driver]:
    """A driver by name or `module:Class`; modules of the current folder first, `.module:Class` of the station there."""
    if name.startswith("."):
        return registry.find(f"{package_of(Path.cwd())}{name}")
    if ":" in name and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    return registry.find(name)


def _describe(tree: Tree, name: str, cls: type[Driver]) -> Tree:
    branch = tree.add(label((name, "bold"), (inspect.cleandoc(cls.__doc__ or "").partition("\n")[0], "")))
    options = [_option(p) for p in inspect.signature(cls).parameters.values()]
    branch.add(f"options: {', '.join([*options, 'timeout', 'watchdog'])}")
    forms = _forms(cls)
    if forms:
        branch.add(f"channels: {forms}")
    return branch


def _option(parameter: inspect.Parameter) -> str:
    has_default = parameter.default is not inspect.Parameter.empty
    return f"{parameter.name} = {parameter.default!r}" if has_default else parameter.name


def _forms(cls: type[Driver]) -> str:
    """The forms that the driver itself names for a channel that it does not know."""
    try:
        channel = cls().channel("?")
    except ChannelError as error:
        return str(error).partition("the forms are: ")[2]
    except (Exception, SystemExit):  # it cannot be made without options
        return ""
    return "any name" if channel.text == "?" else channel.text
