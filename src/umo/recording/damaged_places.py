"""The damaged places of a file: a limited number, so that they take little memory, and whether there are more."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

MAX_PLACES = 1000
"""Number of the first places found that are listed."""


class Damaged(NamedTuple):
    """A place of a file that cannot be read."""

    at: int
    """Offset of the damaged place in bytes."""
    why: str


class DamagedPlaces:
    """The damaged places, each once, in the order in which they were found."""

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
        """Return sentences on the damage in the file of this name before the offset `stop`."""
        yield from (f"{name}, at byte {at:,}: {why}" for at, why in self._why.items() if at < stop)
        if self._has_more:
            yield f"{name}: more places are damaged than these {MAX_PLACES:,}"
