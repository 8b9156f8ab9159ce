"""The laws of a compound: the objects, other than its parts, that its code has made, such as control laws and state
machines."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Any

from umo.objects.compound import Compound
from umo.objects.node import Node
from umo.objects.paths import walk

PLAIN = (bool, int, float, str, Enum)
"""The types of values that a wiring can set."""
NO_LAW = (Node, *PLAIN, type)
"""The types of attributes that are not laws; most are parts."""


def laws_of(node: Compound) -> Iterator[tuple[str, Any]]:
    """Return the public attributes of a compound that are neither parts nor plain data, each with its name; for lists,
    tuples and dicts, the objects in them."""
    for name, value in vars(node).items():
        if name.startswith("_") or isinstance(value, NO_LAW):
            continue
        if isinstance(value, list | tuple | dict):
            each = value.items() if isinstance(value, dict) else enumerate(value)
            yield from [(f"{name}.{key}", law) for key, law in each if not isinstance(law, NO_LAW)]
        else:
            yield name, value


def has_loops(law: Any) -> bool:
    """Return True if an object is a control law, whose loops have experiments (`umo.control.experiment`)."""
    return all(callable(getattr(law.__class__, name, None)) for name in ("experiments", "loops"))


def law_named(node: Compound, name: str) -> Any:
    """Return the law that `laws_of` gives with this name, or None if there is none."""
    attribute, _, key = name.partition(".")
    value = None if attribute.startswith("_") else vars(node).get(attribute)
    if isinstance(value, list | tuple):
        value = value[int(key)] if key.isdecimal() and int(key) < len(value) else None
    elif isinstance(value, dict):
        value = next((law for each, law in value.items() if str(each) == key), None)
    elif key:
        return None
    return None if isinstance(value, NO_LAW) else value


def laws_in(root: Compound) -> Iterator[tuple[Compound, str, Any]]:
    """Return every law of a machine once, with the compound that has it and its path."""
    known: set[int] = set()
    for node in (root, *walk(root)):
        if isinstance(node, Compound):
            for name, law in laws_of(node):
                if id(law) not in known:
                    known.add(id(law))
                    yield node, f"{node._path}.{name}".lstrip("."), law
