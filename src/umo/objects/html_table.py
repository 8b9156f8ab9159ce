"""Tables of objects in HTML, for notebooks. They take colours and font of the notebook, light or dark."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from html import escape
from math import nan
from typing import Any, NamedTuple, TypeVar

from umo.objects.atomic import Atomic
from umo.objects.compound import Compound
from umo.objects.description import described
from umo.objects.families import FROM, families, folded, in_words
from umo.objects.node import Node
from umo.objects.paths import atoms
from umo.objects.quality import Quality
from umo.objects.vector import Vector
from umo.user_code import attempt

T = TypeVar("T")
LONGEST = 200
"""Lines of a table."""
STYLE = (
    "<style>.umo{line-height:1.5;font-variant-numeric:tabular-nums}.umo table{border-collapse:collapse;margin:0}"
    ".umo :is(td,th){text-align:left;padding:1px 1em 1px 0;font-weight:normal;vertical-align:top}"
    ".umo thead th{opacity:.65}.umo td.number{text-align:right}"
    ".umo svg{display:block;width:100%;max-width:900px}</style>"
)
WHY = {
    Quality.OUT_OF_RANGE: "beyond its range",
    Quality.UNREFERENCED: "not homed",
    Quality.STALE: "the device failed: the last value is held",
    Quality.BAD: "the device failed, or was not read yet",
}


class TableRow(NamedTuple):
    """One object, signal or tunable number. `about`: its description (`umo.objects.description`, of the others path and
    unit)."""

    about: Mapping[str, Any]
    value: float = nan
    quality: int | None = None
    raw: int | None = None
    note: str = ""


def heading(title: str, facts: Mapping[str, str]) -> str:
    """A line with the facts that are not empty."""
    said = (f"{escape(name)}: {escape(text)}" for name, text in facts.items() if text)
    return f"<div><b>{escape(title)}</b> &ensp;{' · '.join(said)}</div>"


def html_table(title: str, facts: Mapping[str, str], rows: Sequence[TableRow], *, values: bool = True) -> str:
    """A line for each row, and one for the like ones of lists, with their values or (`values` False) their
    declarations. Columns in which nothing stands are left out."""
    lines = [[rows[place] for place in places] for places in _lines([row.about["path"] for row in rows])]
    cells = {name: [text(line) for line in lines[:LONGEST]] for name, text in (VALUES if values else DECLARED).items()}
    cells = {name: texts for name, texts in cells.items() if any(texts)}
    head = "".join(f"<th>{name}</th>" for name in ("object", *cells))
    paths = [escape(folded([row.about["path"] for row in line])) for line in lines[:LONGEST]]
    body = [
        f"<tr><th>{path}</th>{''.join(map(_cell, cells, texts))}</tr>"
        for path, *texts in zip(paths, *cells.values(), strict=True)
    ]
    more = f"<div>and {len(lines) - LONGEST:,} more; show a part of it</div>" if len(lines) > LONGEST else ""
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>" if rows else ""
    return f'{STYLE}<div class="umo">{heading(title, facts)}{table}{more}</div>'


def never_raises(make: Callable[[T], str]) -> Callable[[T], str]:
    """For `_repr_html_`: what cannot be shown says why."""

    @wraps(make)
    def shown(thing: T) -> str:
        text, error = attempt(make, thing)
        if error is not None:
            text = f"<div><b>{escape(type(thing).__name__)}</b> cannot be shown: {escape(error.text)}</div>"
        return str(text)

    return shown


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
        return html_table(
            title, {"stage": "not connected"}, [TableRow(described(each)) for each in items], values=False
        )
    facts = thing._machine.facts() if isinstance(thing, Compound) else {}
    return html_table(title, facts, list(map(_row, items)))


def _row(item: Atomic) -> TableRow:
    image, slot = item._image, item._slot
    note = inhibition(image.commands.inhibited(slot))
    return TableRow(described(item), float(image.values[slot]), int(image.quality[slot]), int(image.raws[slot]), note)


def inhibition(reason: str | None) -> str:
    """A note on an actuator; empty if it is free."""
    return f"⊘ inhibited: {reason}" if reason else ""


# Columns -----------------------------------------------------------------------------------------------


def _lines(paths: Sequence[str]) -> list[list[int]]:
    """The places of each line: families together, the others one by one; parts of the machine one after another."""
    parts: dict[str, list[list[int]]] = {}
    for path, places in families(paths).items():
        part = parts.setdefault(path.partition(".")[0] if "." in path else "", [])
        part += [places] if len(places) >= FROM else [[place] for place in places]
    return [line for part in parts.values() for line in part]


def _cell(column: str, text: str) -> str:
    """A quality that is not good is in bold."""
    text = escape(text)
    if column == "quality" and text and not text.startswith(Quality.GOOD.sign):
        text = f"<b>{text}</b>"
    return f'<td class="number">{text}</td>' if column in ("value", "raw") else f"<td>{text}</td>"


def _value(line: Sequence[TableRow]) -> str:
    return in_words(line[0].about, [row.value for row in line])


def _quality(line: Sequence[TableRow]) -> str:
    """The worst one; of several how many have it."""
    found = [row.quality for row in line if row.quality is not None]
    if not found:
        return ""
    worst = Quality(max(found))
    count = f"{found.count(worst)} " if worst and len(found) > 1 else ""
    return f"{worst.sign} {count}{worst.words}"


def _raw(line: Sequence[TableRow]) -> str:
    """The raw integer of one object; empty where there is no value yet."""
    row = line[0]
    return "" if len(line) > 1 or row.raw is None or row.value != row.value else str(row.raw)


def _note(line: Sequence[TableRow]) -> str:
    """Why an actuator is inhibited, why a value is not good."""
    worst = max(row.quality or 0 for row in line)
    notes = dict.fromkeys(filter(None, (row.note for row in line)))
    return "; ".join([*list(notes)[:2], *([WHY[Quality(worst)]] if worst else [])])


def _kind(line: Sequence[TableRow]) -> str:
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(line[0].about["kind"])).lower()
    return words if len(line) == 1 else f"{len(line)} x {words}"


def _range(line: Sequence[TableRow]) -> str:
    about = line[0].about
    if "one" in about:
        text = f"{about['zero']} or {about['one']}"
    else:
        unit = about["unit"]
        text = f"{about['minimum']:g} to {about['maximum']:g} {'' if unit == 'sampling_period' else unit}".rstrip()
    default = about.get("default")
    return text if default is None else f"{text}, default {default if isinstance(default, str) else f'{default:g}'}"


def _wiring(line: Sequence[TableRow]) -> str:
    wires = list(dict.fromkeys(filter(None, (row.about.get("wire") for row in line))))
    return f"{wires[0]} .. {wires[-1]}" if len(wires) > 2 else ", ".join(wires)


CellText = Callable[[Sequence[TableRow]], str]
VALUES: dict[str, CellText] = {"value": _value, "quality": _quality, "raw": _raw, "wiring": _wiring, "note": _note}
DECLARED: dict[str, CellText] = {"kind": _kind, "range": _range}
