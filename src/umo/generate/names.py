"""Names in C for paths of Python."""

from __future__ import annotations

import re
from collections.abc import Iterable


def identifier(path: str) -> str:
    """The end of a name in C for a path: `zones_3_heater`."""
    return re.sub(r"\W", "_", path, flags=re.ASCII)


def identifiers(paths: Iterable[str]) -> list[str]:
    """Names for paths, each another one."""
    found: list[str] = []
    for path in paths:
        name = identifier(path)
        while name in found:
            name += "_"
        found.append(name)
    return found
