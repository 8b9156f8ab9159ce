"""The deltas that a gateway has published and still keeps, for those who have missed some."""

from __future__ import annotations

import threading
from collections import deque
from typing import NamedTuple

from umo.fleet.run_words import Delta

MOST = 60
"""Deltas of one answer at most."""
MOST_BYTES = 256 << 10
"""Size of an answer at which it has no further delta."""


class KeptDelta(NamedTuple):
    """A message with what is asked of it."""

    number: int
    is_full: bool
    data: bytes


class KeptDeltas:
    """At least the last `count`, from one on that has all words. Added and asked by different threads."""

    def __init__(self, count: int, full_every: int) -> None:
        self._most = count + full_every
        self._kept: deque[KeptDelta] = deque()
        self._lock = threading.Lock()

    def add(self, delta: Delta, data: bytes) -> None:
        kept = self._kept
        with self._lock:
            kept.append(KeptDelta(delta.number, delta.is_full, data))
            if len(kept) > self._most:
                kept.popleft()
                while kept and not kept[0].is_full:
                    kept.popleft()

    def since(self, number: int) -> tuple[int, list[bytes]]:
        """Number of the last one of all, -1 without any; and those from a number on, as many as one answer holds.
        If the first of them is a later one, nobody has what is between."""
        with self._lock:
            kept = list(self._kept)
        found: list[bytes] = []
        size = 0
        for each in kept:
            if each.number >= number:
                size += len(each.data)
                if found and (len(found) == MOST or size > MOST_BYTES):
                    break
                found.append(each.data)
        return (kept[-1].number if kept else -1), found
