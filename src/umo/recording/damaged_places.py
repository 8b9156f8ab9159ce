"""The damaged places of a file. Only a limited number is listed, to save memory; of further places only their existence
is recorded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

MAX_PLACES = 1000
"""Largest number of places that are listed, beginning with the first one found."""


class Damaged(NamedTuple):
    """A place in a file that cannot be read."""

    at: int
    """Offset of the damaged place in bytes."""
    why: str


class DamagedPlaces:
    """The damaged places of a file, each listed once, in the order in which they were found."""

    def __init__(self) -> None:
        self._why: dict[int, str] = {}
        self._has_more = False

    def add(self, at: int, why: str) -> None:
        if len(self._why) < MAX_PLACES:
            self._why.setdefault(at, why)
        elif at not in self._why:
            self._has_more = True

    def __len__(self) -> int:
        return len(self._why)

    def __iter__(self) -> Iterator[Damaged]:
        return (Damaged(at, why) for at, why in self._why.items())

    def sentences(self, name: str, stop: int) -> Iterator[str]:
        """Return sentences about the damage before the offset `stop` in the file with this name."""
        yield from (f"{name}, at byte {at:,}: {why}" for at, why in self._why.items() if at < stop)
        if self._has_more:
            yield f"{name}: more places are damaged than these {MAX_PLACES:,}"
