"""`umo show parts`: shows the hierarchy of objects (the paper's Figure 4). Similar members of a list are shown as
one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rich.tree import Tree

from umo.drivers import Direction
from umo.errors import DeclarationError
from umo.objects import Atomic, Compound, Node, atoms, children, described, path_of
from umo.objects.keywords import IN_MANUAL
from umo.objects.paths import is_pattern, named
from umo.objects.presentation.rows import FOLDED_FROM, folded
from umo.process.station import Station, StationError
from umo.text import printable, shown_path
from umo.wiring import check
from umo.wiring.patterns import expand
from umo.wiring.source import WiringSource, read
from umo_command.check.report import label, reported
from umo_command.console import out
from umo_command.station_options import machine_and_words

if TYPE_CHECKING:
    from umo.wiring.schema import Entry


def show_tree(station: Station, wiring: str | None, words: Sequence[str] = (), everything: bool = False) -> int:
    """Print all objects, or those at a path. Return 2 if the wiring has errors. `words`: the path, and options of the
    machine."""
    file = station.wiring(wiring)
    machine, paths = machine_and_words(station, words)
    if len(paths) > 1:
        raise StationError(f"unexpected argument {paths[1]!r}: one path at a time")
    path = paths[0] if paths else None
    source = WiringSource("") if file is None else read(file)
    name = "everything simulated" if file is None else file.stem
    expand(source, [item.path for item in atoms(machine)])
    kind, parts = (type(machine).__name__, children(machine)) if path is None else _part(machine, path)
    tree = Tree(label((path or kind, "bold"), *[(kind, "dim")] * bool(path and kind), (name, "dim")))
    _Branches(source, fold=not everything).add(tree, parts, parts)
    out.print(tree)
    if path is None:
        out.print(f"files of {station.name}: {printable(shown_path(str(station.path)))}", style="dim", soft_wrap=True)
    return 2 if reported(check(machine, file)) else 0


def _part(machine: Compound, path: str) -> tuple[str, Mapping[str, Node]]:
    """Return the class and the parts at a path. The parts are those of a compound, the members of a list or dict, the
    matches of a pattern, or the atomic object itself."""
    found = {path_of(node): node for node in named(machine, path)}
    node = found.get(path)
    if isinstance(node, Compound):
        return _class_of(node), children(node)
    return "", {place if is_pattern(path) else each._name: each for place, each in found.items()}


def _class_of(compound: Compound) -> str:
    """`Reactor, equipment`."""
    declared = compound._settings.equipment
    mode = " (in manual mode)" if declared == IN_MANUAL else ""
    return f"{type(compound).__name__}{', equipment' if declared else ''}{mode}"


class _Branches:
    def __init__(self, source: WiringSource, fold: bool) -> None:
        self._entries: Mapping[str, Any] = source.entries
        self._fold = fold

    def add(self, tree: Tree, first: Mapping[str, Node], last: Mapping[str, Node]) -> None:
        """Add the parts of similar compounds. `first`: those of the first compound; `last`: those of the last one."""
        for names in self._alike(first):
            begin, end = first[names[0]], last[names[-1]]
            name = folded(names)
            times = f"{len(names)} x " if len(names) > 1 else ""
            if isinstance(begin, Compound) and isinstance(end, Compound):
                branch = tree.add(label((name, "bold"), (f"{times}{_class_of(begin)}", "dim")))
                self.add(branch, children(begin), children(end))
            elif isinstance(begin, Atomic) and isinstance(end, Atomic):
                style = "green" if begin.direction is Direction.OUTPUT else "cyan"
                wires = " .. ".join(dict.fromkeys([self._wire(begin), self._wire(end)]))
                tree.add(label((name, style), (f"{times}{_declared(begin)}", ""), *[(wires, "yellow")] * bool(wires)))

    def _alike(self, parts: Mapping[str, Node]) -> list[list[str]]:
        """Return the names of the parts, in groups: similar members of a list form a group."""
        groups: dict[object, list[str]] = {}
        for name, child in parts.items():
            of, _, number = name.rpartition(".")
            key = (of, self._meaning(child)) if self._fold and of and number.isdigit() else name
            groups.setdefault(key, []).append(name)
        found: list[list[str]] = []
        for names in groups.values():
            found += [names] if len(names) >= FOLDED_FROM else [[name] for name in names]
        return found

    def _meaning(self, node: Node) -> object:
        """Return all that two similar objects have in common: everything except the numbers of their channels."""
        if isinstance(node, Compound):
            return type(node), tuple((name, self._meaning(child)) for name, child in children(node).items())
        assert isinstance(node, Atomic)
        return _declared(node), re.sub(r"\d+", "#", self._wire(node))

    def _wire(self, item: Atomic) -> str:
        entry = self._entries.get(item.path)
        if entry is None:
            return ""
        return f"{entry.driver}:{entry.channel or item.path}{_overrides(entry)}"


def _declared(item: Atomic) -> str:
    words = [_kind(item), item.describe()]
    if default := described(item).default_text:
        words.append(f"default {default}")
    if not item.synchronous:
        words.append("asynchronous")
    if getattr(item, "incremental", False):
        words.append("incremental")
    return ", ".join(words)


def _kind(item: Atomic) -> str:
    return f"{item._word} {'actuator' if item.direction is Direction.OUTPUT else 'sensor'}"


def _overrides(entry: Entry) -> str:
    """Return the changes of the declaration by the circuit that are not numbers. A mistake is left to `check`."""
    text = " inverted" if entry.inverted else ""
    if entry.linearization is not None:
        with suppress(DeclarationError):
            text += " linear" if entry.linearization.is_empty else f" through a {entry.linearization.made()}"
    if entry.invalid_raws:
        text += f" invalid {', '.join(map(str, entry.invalid_raws))}"
    if entry.rollover:
        text += " rolls over" + ("" if entry.rollover is True else f" at {entry.rollover} bits")
    return text
