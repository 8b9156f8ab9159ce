"""The laws of a compound: what its code has made besides its parts, such as control laws and state machines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Any

from umo.objects.compound import Compound
from umo.objects.node import Node
from umo.objects.paths import walk

PLAIN = (bool, int, float, str, Enum)
"""The types of what a wiring can set."""
NO_LAW = (*PLAIN, Node, type)
"""The types of attributes that are no laws."""


def laws_of(node: Compound) -> Iterator[tuple[str, Any]]:
    """Its public attributes that are neither parts nor plain data, of lists, tuples and dicts what is in them, each
    with its name."""
    for name, value in vars(node).items():
        if name.startswith("_") or isinstance(value, NO_LAW):
            continue
        found: Iterable[tuple[str, Any]] = [(name, value)]
        if isinstance(value, list | tuple):
            found = ((f"{name}.{number}", each) for number, each in enumerate(value))
        elif isinstance(value, dict):
            found = ((f"{name}.{key}", each) for key, each in value.items())
        yield from (each for each in found if not isinstance(each[1], NO_LAW))


def laws_in(root: Compound) -> Iterator[tuple[Compound, str, Any]]:
    """Every law of a machine once, with the compound that has it and its path."""
    known: set[int] = set()
    for node in (root, *walk(root)):
        if isinstance(node, Compound):
            for name, law in laws_of(node):
                if id(law) not in known:
                    known.add(id(law))
                    yield node, f"{node._path}.{name}".lstrip("."), law
