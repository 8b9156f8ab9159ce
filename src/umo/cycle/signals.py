"""Signals: numbers of the control code that are shown beside the objects, such as setpoint and error of a law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from inspect import getattr_static
from typing import Any, NamedTuple

from umo.errors import DeclarationError
from umo.objects import Compound, walk
from umo.objects.units import check_unit
from umo.user_code import attempt

_MISSING = object()


class Signal(NamedTuple):
    """One number: an attribute of a compound, or of a law that is an attribute of a compound or in a list, tuple or
    dict that is one."""

    path: str
    """Such as `z.servo.error`."""
    unit: str
    owner: Any
    name: str


def signals_of(root: Compound) -> tuple[Signal, ...]:
    """The numbers that compounds and their laws declare in `signals`: units by the name of the attribute.
    DeclarationError for an attribute that is missing or a unit that is not one."""
    return tuple(_all(root))


def _all(root: Compound) -> Iterator[Signal]:
    for node in [root, *walk(root)]:
        if isinstance(node, Compound):
            yield from _of(node, node._path)
            found: set[int] = set()  # a law that is in a list as well is shown once
            for name, law in _public(node):
                if not isinstance(law, Compound) and id(law) not in found:
                    found.add(id(law))
                    yield from _of(law, f"{node._path}.{name}".lstrip("."))


def _public(node: Compound) -> Iterator[tuple[str, Any]]:
    """Its attributes with public names, of lists, tuples and dicts what is in them."""
    for name, value in vars(node).items():
        if name.startswith("_"):
            continue
        if isinstance(value, list | tuple):
            yield from ((f"{name}.{number}", each) for number, each in enumerate(value))
        elif isinstance(value, dict):
            yield from ((f"{name}.{key}", each) for key, each in value.items())
        else:
            yield name, value


def _declared(owner: Any) -> Any:
    if not isinstance(owner, Compound):
        return getattr(owner, "signals", None)
    return given(owner) if callable(given := owner._settings.signals) else given


def _of(owner: Any, path: str) -> Iterator[Signal]:
    declared, error = attempt(_declared, owner)
    if error is not None:
        raise DeclarationError(f"signals of {path or type(owner).__name__} failed: {error}")
    if not isinstance(declared, Mapping):
        return
    for name, unit in declared.items():
        full = f"{path}.{name}".lstrip(".")
        if getattr_static(owner, name, _MISSING) is _MISSING:  # a property may need the machine connected
            raise DeclarationError(f"signal {full}: {type(owner).__name__} has no attribute {name!r}")
        try:
            check_unit(unit)
        except DeclarationError as error:
            raise DeclarationError(f"signal {full}: {error}") from None
        yield Signal(full, unit, owner, name)
