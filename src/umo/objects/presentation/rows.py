"""Objects, signals and tunable numbers as rows of a table, with similar rows in one line, and the texts of the
cells."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import nan
from typing import NamedTuple

from umo.objects.presentation.described import Described
from umo.objects.presentation.value_text import WHY, quality_text
from umo.text import printable

INHIBITED, BY_CLIENT = "inhibited", "by client"
ANY = "*"
"""Part of a pattern that stands for any part of a path."""
FOLDED_FROM = 3
"""Number of members from which on a family is shown as one line."""


def generalised(path: str) -> str:
    """Return a path with `*` for its indexes."""
    return ".".join(ANY if part.isdigit() else part for part in path.split("."))


def families(paths: Iterable[str]) -> dict[str, list[int]]:
    """Return the indices of the paths by family, such as `zones.*.heater`, in the order of the first members."""
    found: dict[str, list[int]] = {}
    for place, path in enumerate(paths):
        found.setdefault(generalised(path), []).append(place)
    return found


def folded(paths: Sequence[str]) -> str:
    """Return the name of a family: `zones[0..39].heater`, `zones[0..2, 4..39].heater`."""
    name = ""
    for parts in zip(*(path.split(".") for path in paths), strict=True):
        if not parts[0].isdigit() or len(numbers := {int(part) for part in parts}) == 1:
            name += f".{parts[0]}"
            continue
        firsts = sorted(number for number in numbers if number - 1 not in numbers)
        lasts = sorted(number for number in numbers if number + 1 not in numbers)
        spans = zip(firsts, lasts, strict=True)
        name += f"[{', '.join(str(first) if first == last else f'{first}..{last}' for first, last in spans)}]"
    return name.lstrip(".")


class TableRow(NamedTuple):
    """One object, signal or tunable number."""

    about: Described
    value: float = nan
    quality: int | None = None
    raw: int | None = None
    note: str = ""


LikeRows = Sequence[TableRow]
"""One row, or several of a family."""


def lines(paths: Sequence[str]) -> list[list[int]]:
    """Return the indices of the rows in each line: the rows of a family together, other rows one by one, in the order
    of the parts of the machine."""
    parts: dict[str, list[list[int]]] = {}
    for path, places in families(paths).items():
        part = parts.setdefault(path.partition(".")[0] if "." in path else "", [])
        part += [places] if len(places) >= FOLDED_FROM else [[place] for place in places]
    return [line for part in parts.values() for line in part]


def restriction(reason: str | None, by_client: bool = False) -> str:
    """Return why the program cannot write an actuator, and who has the actuator; empty if the program can write it."""
    return f"⊘ {BY_CLIENT if by_client else INHIBITED}: {reason}" if reason else ""


def value_of(line: LikeRows) -> str:
    return line[0].about.text(*(row.value for row in line))


def worst_of(line: LikeRows) -> int:
    """Return the number of the worst quality; 0 if there is none."""
    return max(row.quality or 0 for row in line)


def quality_of(line: LikeRows) -> str:
    """Return the worst quality and, for several rows, how many have it."""
    found = [row.quality for row in line if row.quality is not None]
    worst = max(found, default=0)
    return quality_text(worst, found.count(worst) if worst and len(found) > 1 else None) if found else ""


def sentence_of(row: TableRow, width: int = 0) -> str:
    """Return path, value, quality and note of one object, separated by two blanks, with the path padded to this
    width."""
    cells = [f"{row.about.path:{width}}", value_of([row]), quality_of([row]), note_of([row])]
    return printable("  ".join(filter(None, cells)))


def raw_of(line: LikeRows) -> str:
    """Return the raw integer of one object; empty if there is no value yet."""
    row = line[0]
    return "" if len(line) > 1 or row.raw is None or row.value != row.value else str(row.raw)


def note_of(line: LikeRows) -> str:
    """Return the reasons why an actuator is inhibited and why a value is not good."""
    notes = dict.fromkeys(filter(None, (row.note for row in line)))
    return "; ".join(filter(None, [*list(notes)[:2], WHY[worst_of(line)]]))


def kind_of(line: LikeRows) -> str:
    """Return the kind of rows, such as `digital actuator` or `40 x digital actuator`."""
    words = line[0].about.kind_text
    return words if len(line) == 1 else f"{len(line)} x {words}"


def range_of(line: LikeRows) -> str:
    """Return range and default, such as `0 to 10 V, default 0 V` or `OFF or ON, default OFF`."""
    about = line[0].about
    return f"{about.range_text}, default {about.default_text}" if about.default_text else about.range_text


def declared_of(line: LikeRows) -> str:
    """Return the declaration of rows, such as `digital actuator, 0 to 10 V, default 0 V`."""
    return f"{kind_of(line)}, {range_of(line)}"


def wiring_of(line: LikeRows) -> str:
    wires = list(dict.fromkeys(filter(None, (row.about.wire for row in line))))
    return f"{wires[0]} .. {wires[-1]}" if len(wires) > 2 else ", ".join(wires)


CellText = Callable[[LikeRows], str]
VALUES: dict[str, CellText] = {
    "value": value_of,
    "quality": quality_of,
    "raw": raw_of,
    "wiring": wiring_of,
    "note": note_of,
}
DECLARED: dict[str, CellText] = {"kind": kind_of, "range": range_of}
