"""`umo check`, `umo tree`, `umo drivers`."""

from __future__ import annotations

import inspect

from rich.text import Text
from rich.tree import Tree

from umo.drivers import Direction, Driver, registry
from umo.errors import ChannelError, Fault, WiringError
from umo.objects import Atomic, Compound, Digital, DigitalActuator, Node
from umo.objects.interlock import interlocks_of
from umo.process.station import Station
from umo.wiring import check, resolve
from umo.wiring.patterns import expand
from umo.wiring.source import WiringSource, read

from .console import err, out


def check_station(station: Station, wiring: str | None) -> int:
    """Print every fault and return 2, or one line on what is wired and return 0."""
    file = station.wiring(wiring)
    machine = station.machine()
    station.module("application")  # a wiring may be right and the application not import
    interlocks_of(machine)
    faults = check(machine, file)
    if _reported(faults):
        return 2
    wired = resolve(machine, file)
    period = "no timer" if wired.period is None else f"period {wired.period * 1e3:g} ms"
    name = file or "everything simulated"
    out.print(f"ok: {name}: {len(wired.wires)} objects on {len(wired.drivers)} drivers, {period}", soft_wrap=True)
    return 0


def _reported(faults: list[Fault]) -> int:
    """Print every fault; how many there are."""
    for fault in faults:
        err.print(str(fault), soft_wrap=True)
    return len(faults)


def show_tree(station: Station, wiring: str | None) -> int:
    """The hierarchy of Figure 4, each object with its units, range and wiring; 2 if the wiring has faults."""
    file = station.wiring(wiring)
    machine = station.machine()
    source = WiringSource("") if file is None else read(file)
    name = "everything simulated" if file is None else file.stem
    tree = Tree(_label((type(machine).__name__, "bold"), (name, "dim")))
    expand(source, [item.path for item in machine.atoms()])
    _branch(tree, machine, source)
    out.print(tree)
    return 2 if _reported(check(machine, file)) else 0


def _label(*words: tuple[str, str]) -> Text:
    """Words, each with its style, two blanks apart."""
    return Text("  ").join(Text(word, style) for word, style in words)


def _branch(tree: Tree, compound: Compound, source: WiringSource) -> None:
    for name, child in compound.children().items():
        if isinstance(child, Compound):
            _branch(tree.add(_label((name, "bold"), (type(child).__name__, "dim"))), child, source)
        else:
            tree.add(_leaf(name, child, source))


def _leaf(name: str, item: Node, source: WiringSource) -> Text:
    assert isinstance(item, Atomic)
    entry = source.entries.get(item.path)
    wire = "" if entry is None else f"{entry.driver}:{entry.channel or item.path}"
    if entry is not None and entry.inverted:
        wire += " inverted"
    style = "green" if item.direction is Direction.OUTPUT else "cyan"
    words = [(name, style), (_declared(item), "")] + [(wire, "yellow")] * bool(wire)
    return _label(*words)


def _declared(item: Atomic) -> str:
    words = [_kind(item), item.describe()]
    default = getattr(item, "default", None)
    if default is not None:
        words.append(f"default {default:g} {item.units}" if isinstance(item, DigitalActuator) else f"default {default}")
    if not item.synchronous:
        words.append("asynchronous")
    if getattr(item, "incremental", False):
        words.append("incremental")
    return ", ".join(words)


def _kind(item: Atomic) -> str:
    number = "digital" if isinstance(item, Digital) else "binary"
    return f"{number} {'actuator' if item.direction is Direction.OUTPUT else 'sensor'}"


def show_drivers() -> None:
    """Every registered driver: its options and channels, or why it cannot be imported."""
    tree = Tree("drivers; a wiring may also name module:Class")
    for name in registry.known():
        try:
            _describe(tree, name, registry.find(name))
        except WiringError as error:
            tree.add(_label((name, "bold"), (str(error), "red")))
    out.print(tree)


def _describe(tree: Tree, name: str, cls: type[Driver]) -> None:
    branch = tree.add(_label((name, "bold"), ((inspect.getdoc(cls) or "").partition("\n")[0], "")))
    options = [_option(p) for p in inspect.signature(cls).parameters.values()]
    branch.add(f"options: {', '.join([*options, 'timeout', 'watchdog'])}")
    forms = _forms(cls)
    if forms:
        branch.add(f"channels: {forms}")


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
