"""Descriptions of objects, for other processes and for tables."""

from __future__ import annotations

from typing import Any

from umo.objects.atomic import Atomic
from umo.objects.compound import Compound
from umo.objects.node import Node
from umo.objects.paths import atoms
from umo.objects.presentation.described import Described
from umo.objects.presentation.html_table import html_table, never_raises
from umo.objects.presentation.rows import TableRow, restriction
from umo.objects.units import convert, line_between
from umo.objects.vector import Vector


def described(item: Atomic) -> Described:
    """Return path, kind and meaning of an object and, if the object is connected, its wiring (`wire`)."""
    about: dict[str, Any] = {"path": item.path, "kind": type(item).__name__, "synchronous": item.synchronous}
    if item.connected:
        about["wire"] = item._image.wire_texts[item._slot]
    return Described(about | item._about())


def row_of(item: Atomic) -> TableRow:
    """Return a connected object with its value in the process image; no device is accessed."""
    image, slot = item._image, item._slot
    note = restriction(image.claims.inhibited(slot))
    return TableRow(described(item), float(image.values[slot]), int(image.quality[slot]), int(image.raws[slot]), note)


def converted(row: TableRow, unit: str | None) -> TableRow:
    """Return a number in another unit, with its resolution; a value without a unit is unchanged. Raises
    DeclarationError and RangeError in the cases of `convert`."""
    about = row.about
    if unit is None or not about.is_number:
        return row
    value = convert(row.value, about.unit, unit)
    return row._replace(about=about.in_unit(unit, line_between(about.unit, unit)), value=value)


@never_raises
def html_of(thing: Node | Vector[Any]) -> str:
    """Return HTML of an object, of a compound with all objects below it, or of a Vector. Values are those of the
    process image; no device is accessed."""
    if isinstance(thing, Vector):
        title, items = f"Vector of {len(thing)}", list(thing)
    else:
        title = f"{type(thing).__name__} {thing._path}".rstrip()
        items = list(atoms(thing)) if isinstance(thing, Compound) else [thing] if isinstance(thing, Atomic) else []
    connected = thing.cycle.connected if isinstance(thing, Compound) else all(item.connected for item in items)
    if not connected:
        rows = [TableRow(described(each)) for each in items]
        return html_table(title, {"state": "not connected"}, rows, values=False)
    facts = thing._machine.facts() if isinstance(thing, Compound) else {}
    return html_table(title, facts, list(map(row_of, items)))


# notebooks show them so
Node._repr_html_ = html_of  # type: ignore[attr-defined]
Vector._repr_html_ = html_of  # type: ignore[attr-defined]
