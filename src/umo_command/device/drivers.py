"""`umo device drivers`: lists the drivers, or describes one of them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.text import Text
from rich.tree import Tree

from umo.drivers import Driver, HasWatchdog, registry
from umo.drivers.optional import OPTIONAL, names_of
from umo.errors import ChannelError, WiringError, text_of
from umo.signature import parameters_of, signature_of
from umo.system.packages import package_of
from umo.text import options_in
from umo_command.check.report import label
from umo_command.console import out
from umo_command.shared import import_from_here
from umo_command.station_options import options_of_driver, values_of

_MODULES = re.compile(r"\b[a-z_]\w*\.(?=[\w.])")
"""The modules before the name of a type."""
FUNCTIONS = {
    name: function
    for kind in (Driver, *OPTIONAL)
    for name in names_of(kind)
    if callable(function := getattr(kind, name))
}
"""Functions of a driver in the order of the contract, then the optional ones."""
COMMON_OPTIONS = {
    "timeout": ("duration = 10 periods, at most 1 s", "time limit of one call of the driver"),
    "watchdog": (
        "duration",
        "watchdog of the circuit: its outputs go to safe levels after this time without a request",
    ),
}
"""Options that every driver has in the wiring. Only drivers with a watchdog have the last one."""


def show_drivers() -> None:
    """Print every registered driver with its options and channels, or the reason why it cannot be imported."""
    tree = Tree("drivers; a wiring may also name module:Class")
    for known in registry.known():
        try:
            cls = registry.find(known)
        except WiringError as error:
            tree.add(label((known, "bold"), (str(error), "red")))
            continue
        branch = tree.add(label((known, "bold"), (_first_sentence(cls), "")))
        options = parameters_of(cls).values()
        brief = [each.name if each.default is each.empty else f"{each.name} = {each.default!r}" for each in options]
        branch.add(Text(f"options: {', '.join([*brief, *_of_all(cls)])}"))
        if forms := _forms(cls, {}):
            branch.add(Text(f"channels: {forms}"))
    out.print(tree)


def show_driver(name: str, arguments: Sequence[str]) -> None:
    """Print the driver with this name, or `module:Class`: its docstring, its options with their types, its channels and
    functions. `arguments` are options. Some drivers need them to know their channels."""
    cls = _find(name)
    given = values_of(name, options_of_driver(cls, name), arguments)
    doc = _doc(cls)
    first, *others = doc.split("\n\n")
    tree = Tree(label((cls.__name__, "bold"), (" ".join(first.split()), "")))
    options = tree.add("options")
    described = options_in(doc)
    for key, parameter in parameters_of(cls).items():
        options.add(label((_written(parameter), "cyan"), (described.get(key, ""), "")))
    for key, (kind, text) in _of_all(cls).items():
        options.add(label((f"{key}: {kind}", "cyan"), (text, "")))
    tree.add(
        Text(f"channels: {_forms(cls, given) or 'known only with the options of the driver: give them after its name'}")
    )
    own = [name for name, default in FUNCTIONS.items() if getattr(cls, name, default) is not default]
    tree.add(Text(f"additional functions: {', '.join(own)}"))
    out.print(tree)
    for paragraph in others:
        if not paragraph.startswith("Options:\n"):
            out.print(Text(f"\n{paragraph}"))


def _find(name: str) -> type[Driver]:
    """Return the driver with this name or `module:Class`. Modules of the current folder come first; `.module:Class` is
    a class of the station in this folder."""
    if name.startswith("."):
        return registry.find(f"{package_of(Path.cwd())}{name}")
    if ":" in name:
        import_from_here()
    return registry.find(name)


def _doc(cls: type[Driver]) -> str:
    """Return the docstring of the class itself. An inherited docstring of `Driver` would not describe it."""
    return inspect.cleandoc(cls.__doc__ or "")


def _first_sentence(cls: type) -> str:
    paragraph = " ".join(_doc(cls).partition("\n\n")[0].split())
    return re.split(r"(?<=\.) ", paragraph)[0]


def _of_all(cls: type[Driver]) -> dict[str, tuple[str, str]]:
    has_watchdog = issubclass(cls, HasWatchdog)
    return {key: value for key, value in COMMON_OPTIONS.items() if key != "watchdog" or has_watchdog}


def _written(parameter: inspect.Parameter) -> str:
    """Return an option as text: `host: str = '127.0.0.1'`, as in the source, or `model: Path (required)`."""
    kind = parameter.annotation
    written = "" if kind is parameter.empty else f": {_MODULES.sub('', inspect.formatannotation(kind))}"
    name = f"{parameter.name}{written}"
    return f"{name} (required)" if parameter.default is parameter.empty else f"{name} = {parameter.default!r}"


def _forms(cls: type[Driver], given: dict[str, Any]) -> str:
    """Return the forms of channels that the driver names in its error for an unknown channel. If the driver cannot be
    made without options, return the forms that its class names. If options are given, an error of the constructor is an
    error of the user."""
    from umo.wiring.schema import options_of  # pydantic: not for a plain list of drivers

    try:
        driver = cls(**options_of(cls.__name__, signature_of(cls), given)) if given else cls()
    except (Exception, SystemExit) as error:
        if given:
            raise WiringError(text_of(error)) from error
        return ", ".join(cls.forms)
    try:
        driver.channel("?")
    except ChannelError as error:
        return str(error).partition("the forms are: ")[2]
    except (Exception, SystemExit):
        return ""
    return "any text"
