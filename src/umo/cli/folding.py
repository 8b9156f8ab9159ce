"""Objects and signals by name: chosen by paths and patterns, the like ones of lists folded into families."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from umo.errors import PathError
from umo.text import did_you_mean
from umo.wiring.patterns import ANY, generalised, matches

FROM = 3
"""Members from which a family is folded."""


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


def chosen(known: Sequence[str], wanted: Iterable[str], where: str) -> list[int]:
    """The places of the paths that are wanted: paths of objects, of compounds, or patterns (`zones.*.heater`) for
    either. Each once, in the order wanted; all if none is. PathError for one that names nothing."""
    places: dict[int, None] = {}
    for path in wanted:
        found = [place for place, name in enumerate(known) if _is_below(path, name)]
        if not found:
            near = did_you_mean(path, [*known, *dict.fromkeys(map(generalised, known))])
            raise PathError(f"no object or signal {path!r}{near} in {where}")
        places.update(dict.fromkeys(found))
    return list(places) or list(range(len(known)))


def _is_below(path: str, name: str) -> bool:
    """Whether a name is the path itself or in the compound at the path."""
    if ANY not in path:
        return name == path or name.startswith(f"{path}.")
    depth = path.count(".") + 1
    return matches(path, ".".join(name.split(".")[:depth]))
