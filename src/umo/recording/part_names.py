"""The names of the files of a recording that is rotated: `run.mcap`, `run.2.mcap`, `run.3.mcap`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

SUFFIX = ".mcap"
_PART = re.compile(r"(.+)\.(\d+)")


def part_name(path: Path, number: int) -> Path:
    """The name of a part, from 1 on, of the recording of this name."""
    return path if number == 1 else path.with_name(f"{path.name.removesuffix(SUFFIX)}.{number}{SUFFIX}")


def later_parts(path: Path) -> Iterator[Path]:
    """The files that follow a part."""
    found = _PART.fullmatch(path.name.removesuffix(SUFFIX))
    base, number = (path.with_name(f"{found[1]}{SUFFIX}"), int(found[2])) if found else (path, 1)
    while (part := part_name(base, number := number + 1)).exists():
        yield part
