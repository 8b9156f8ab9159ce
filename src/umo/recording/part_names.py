"""The names of the files of a recording that is rotated: `run.mcap`, `run.2.mcap`, `run.3.mcap`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

SUFFIX = ".mcap"
_PART = re.compile(r"(.+)\.(\d+)")


def part_name(path: Path, number: int) -> Path:
    """Return the name of a part of the recording with this name. Parts are numbered from 1 on."""
    return path if number == 1 else path.with_name(f"{path.name.removesuffix(SUFFIX)}.{number}{SUFFIX}")


def later_parts(path: Path, number: int = 1) -> Iterator[Path]:
    """Return the files that follow this file, which is the part with this number. A first part may also be named
    `run.2.mcap`."""
    base = path
    if number > 1:
        found = _PART.fullmatch(path.name.removesuffix(SUFFIX))
        if found is None or int(found[2]) != number:  # it was renamed
            return
        base = path.with_name(f"{found[1]}{SUFFIX}")
    while (part := part_name(base, number := number + 1)).exists():
        yield part
