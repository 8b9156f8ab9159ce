"""Objects as plain data, for other processes and for tables."""

from __future__ import annotations

from typing import Any

from umo.objects.actuators import BinaryActuator, DigitalActuator
from umo.objects.atomic import Atomic, Binary, Digital
from umo.objects.compound import Compound
from umo.objects.node import Node
from umo.objects.paths import atoms
from umo.objects.units import convert, line_between
from umo.objects.vector import Vector
from umo.presentation.html_table import html_table, never_raises
from umo.presentation.rows import TableRow, restriction


def described(item: Atomic) -> dict[str, Any]:
    """Path, kind and meaning of an object; once it is connected, how it is wired (`wire`). Without a linearization the
    resolution and the zero offset, from which its digits follow."""
    what: dict[str, Any] = {"path": item.path, "kind": type(item).__name__, "synchronous": item.synchronous}
    if item.connected:
        what["wire"] = item._image.wire_texts[item._slot]
    if isinstance(item, BinaryActuator | DigitalActuator):
        default = item.default if isinstance(item, DigitalActuator) else str(item.default)
        what |= {"actuator": True, "default": default, "expires": item.expires}
        what["when_suspended"] = item.when_suspended
    if isinstance(item, Digital):
        what |= {"unit": item.units, "minimum": item.minimum, "maximum": item.maximum}
        if item.linearization is None:
            what |= {"resolution": item.resolution, "zero_offset": item.zero_offset}
        return what
    assert isinstance(item, Binary)
    return what | {"one": str(item.one), "zero": str(item.zero)}


def row_of(item: Atomic) -> TableRow:
    """A connected object with its value in the process image: no device is accessed."""
    image, slot = item._image, item._slot
    note = restriction(image.commands.inhibited(slot))
    return TableRow(described(item), float(image.values[slot]), int(image.quality[slot]), int(image.raws[slot]), note)


def converted(row: TableRow, unit: str | None) -> TableRow:
    """A number in another unit, with its resolution; what has no unit as it is. DeclarationError, RangeError as of
    `convert`."""
    about = row.about
    if unit is None or "one" in about or "states" in about:
        return row
    value = convert(row.value, about["unit"], unit)
    shown = {name: about[name] for name in about if name not in ("resolution", "zero_offset")} | {"unit": unit}
    line = line_between(about["unit"], unit)
    if line is not None and "resolution" in about:
        factor, offset = line
        shown |= {"resolution": about["resolution"] * factor, "zero_offset": about["zero_offset"] * factor + offset}
    return row._replace(about=shown, value=value)


@never_raises
def html_of(thing: Node | Vector[Any]) -> str:
    """An object, or many: a compound with all below it, a Vector. Values are those of the process image: no device is
    accessed."""
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
