"""Like objects of lists in one line: which belong together, what they are called."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

ANY = "*"
"""In a pattern: any part of a path."""
FROM = 3
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
    """The name of a family: `zones[0..39].heater`."""
    name = ""
    for parts in zip(*(path.split(".") for path in paths), strict=True):
        if not parts[0].isdigit() or len(numbers := {int(part) for part in parts}) == 1:
            name += f".{parts[0]}"
        else:
            name += f"[{min(numbers)}..{max(numbers)}]"
    return name.lstrip(".")
