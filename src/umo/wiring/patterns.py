"""Patterns in a wiring: one line for many similar objects.

    "zones.*.heater" = { driver = "box", channel = "holding:{}", start = 1, stride = 4, offset = 100 }
    "zones.*.gain" = 2.0

A `*` stands for one part of a path: an index of a list, a key of a dict, a name. In the channel `{}` is `(start + n) *
stride + offset`, where n is the index (from 0) of the object among the matching objects in declared order. By default
`{}` is n. An entry for a single path takes precedence over a pattern, but its object is still counted.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from umo.errors import Mistake, PathError
from umo.objects.paths import is_pattern, matches
from umo.objects.presentation.rows import ANY, generalised
from umo.text import did_you_mean
from umo.wiring.source import WiringSource

if TYPE_CHECKING:
    from umo.wiring.schema import Entry

NUMBER = "{}"
NUMBERING = ("start", "stride", "offset")
V = TypeVar("V")


def chosen(known: Sequence[str], wanted: Iterable[str], where: str) -> list[int]:
    """Return the indices of the selected paths. A selection names objects or compounds by paths or patterns
    (`zones.*.heater`). Each index appears once, in the order of the selection. Without a selection, all indices are
    returned. Raises PathError for a path without an object."""
    places: dict[int, None] = {}
    for path in wanted:
        found = places_below(path, known)
        if not found:
            near = did_you_mean(path, [*known, *dict.fromkeys(map(generalised, known))])
            raise PathError(f"there is no object or signal {path!r}{near} in {where}")
        places.update(dict.fromkeys(found))
    return list(places) or list(range(len(known)))


def expand(source: WiringSource, paths: Iterable[str]) -> dict[str, str]:
    """Replace every pattern among the entries by an entry for each object that matches. Also return the pattern of each
    path. The paths of refused entries are expanded, too."""
    paths = list(paths)
    patterns = {path: source.entries.pop(path) for path in list(source.entries) if is_pattern(path)}
    singles = source.entries.keys() | source.refused
    source.refused |= {path for each in filter(is_pattern, singles) for path in paths if matches(each, path)}
    for path, entry in source.entries.items():
        _check_numbering(source, path, entry, single=True)
    for pattern, entry in patterns.items():
        _check_numbering(source, pattern, entry, single=False)
    allotted = _allotted(source, patterns, paths, singles, 'wire."{}"', "no object of the machine matches", "wired")
    for pattern, found in allotted.items():
        source.entries |= {path: _numbered(patterns[pattern], number) for path, number in found.items()}
    return {path: pattern for pattern, found in allotted.items() for path in found}


def expand_parameters(source: WiringSource, known: Iterable[str]) -> dict[str, list[tuple[str, Any]]]:
    """Return for each line of the parameters the names that it sets, each with its value. A pattern sets the matching
    names that no other line names directly."""
    given = source.parameters
    patterns = list(filter(is_pattern, given))
    allotted = _allotted(source, patterns, list(known), given, "parameters.{!r}", "there is no such parameter", "set")
    return {key: [(name, value) for name in allotted.get(key, (key,))] for key, value in given.items()}


def _allotted(
    source: WiringSource,
    patterns: Iterable[str],
    names: Sequence[str],
    singles: Container[str],
    key: str,
    missing: str,
    done: str,
) -> dict[str, dict[str, int]]:
    """Return the names that each pattern wires, each with its index among the matching names. Names with a line of
    their own (`singles`) are left out. It is a mistake (reported under `key`) if a pattern matches no name, or a name
    that another pattern wires."""
    origin: dict[str, str] = {}
    allotted: dict[str, dict[str, int]] = {}
    twice: dict[tuple[str, str], list[str]] = {}
    for pattern in patterns:
        found = [name for name in names if matches(pattern, name)]
        if not found:
            near = source.near(pattern, dict.fromkeys(map(generalised, names)))
            source.mistake(key.format(pattern), f"{missing}{near}")
        free = {name: number for number, name in enumerate(found) if name not in singles}
        for name in filter(origin.__contains__, free):
            twice.setdefault((pattern, origin[name]), []).append(name)
        allotted[pattern] = {name: number for name, number in free.items() if name not in origin}
        origin |= dict.fromkeys(allotted[pattern], pattern)
    for (pattern, other), found in twice.items():
        source.mistake(key.format(pattern), counted(f"{found[0]} is {done} by {other!r} as well", len(found) - 1))
    return allotted


def collapsed(mistakes: Iterable[Mistake], origin: Mapping[str, str]) -> list[Mistake]:
    """Return the mistakes of the entries that were made from patterns, each under the key of the pattern. Equal
    mistakes are returned once."""
    grouped: dict[tuple[str, str], list[Mistake]] = {}
    for mistake in mistakes:
        found = re.fullmatch(r'wire\."(.*)"(.*)', mistake.key)  # such as `wire."z.motor".channel`
        path, rest = found.groups() if found else ("", "")
        if path in origin:
            mistake = Mistake(mistake.file, f'wire."{origin[path]}"{rest}', f"{path}: {mistake.message}")
        alike = re.sub(r"\d+", "0", mistake.message) if path in origin else f"{mistake.message} {len(grouped)}"
        grouped.setdefault((mistake.key, alike), []).append(mistake)
    firsts = [(group[0], len(group) - 1) for group in grouped.values()]
    return [Mistake(first.file, first.key, counted(first.message, more)) for first, more in firsts]


def _check_numbering(source: WiringSource, path: str, entry: Entry, single: bool) -> None:
    given = [name for name in NUMBERING if getattr(entry, name) is not None]
    if given and single:
        source.mistake(f'wire."{path}".{given[0]}', f"can only be used with patterns such as {generalised(path)!r}")
    elif given and NUMBER not in (entry.channel or ""):
        source.mistake(f'wire."{path}".{given[0]}', f"has no effect, because the channel contains no {NUMBER}")


def _numbered(entry: Entry, number: int) -> Entry:
    if entry.channel is None:
        return entry
    stride = 1 if entry.stride is None else entry.stride
    place = ((entry.start or 0) + number) * stride + (entry.offset or 0)
    return entry.model_copy(update={"channel": entry.channel.replace(NUMBER, str(place))})


def places_below(path: str, names: Iterable[str]) -> list[int]:
    """Return the indices of the names that equal the path or lie in the compound at the path. The path may be a
    pattern."""
    parts = ("[^.]*" if part == ANY else re.escape(part) for part in path.split("."))
    is_below = re.compile(r"\.".join(parts) + r"(?:\.|\Z)").match
    return [place for place, name in enumerate(names) if is_below(name)]


def counted(message: str, more: int) -> str:
    """Return a message that stands for several messages of its kind."""
    return message if not more else f"{message} (and {more} more)"
