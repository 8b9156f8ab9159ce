"""Like objects of lists in one line: which belong together, what they are called, what their values are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any

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


def in_words(about: Mapping[str, Any], values: Sequence[float]) -> str:
    """The value of an object or signal with its unit, or its state; of a family from the least to the greatest.
    `about`: its description, with `unit`, or with `one` and `zero`."""
    known = [value for value in values if isfinite(value)]
    if not known:
        return "-"
    if "one" in about:
        ones = sum(value > 0.5 for value in known)
        if ones in (0, len(known)):
            return str(about["one"] if ones else about["zero"])
        return f"{ones} {about['one']}, {len(known) - ones} {about['zero']}"
    unit = "" if about["unit"] == "sampling_period" else f" {about['unit']}"
    least, most = _number(min(known)), _number(max(known))
    return (f"{least}{unit}" if least == most else f"{least} to {most}{unit}").rstrip()


def _number(value: float) -> str:
    return f"{value:.1f}" if abs(value) >= 1000 else f"{value:.4g}"
