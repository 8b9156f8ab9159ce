"""Like objects of lists in one line: which belong together, what they are called."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

ANY = "*"
"""Part of a pattern that stands for any part of a path."""
FOLDED_FROM = 3
"""Members from which a family is folded."""


def generalised(path: str) -> str:
    """A path with `*` for its indexes."""
    return ".".join(ANY if part.isdigit() else part for part in path.split("."))


def families(paths: Iterable[str]) -> dict[str, list[int]]:
    """The places of the paths by family, such as `zones.*.heater`, in the order of the first members."""
    found: dict[str, list[int]] = {}
    for place, path in enumerate(paths):
        found.setdefault(generalised(path), []).append(place)
    return found


def folded(paths: Sequence[str]) -> str:
    """The name of a family: `zones[0..39].heater`, `zones[0..2, 4..39].heater`."""
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
