"""The deltas that a gateway has published and still keeps, for recorders and mirrors that have missed some."""

from __future__ import annotations

import threading
from collections import deque
from itertools import takewhile
from typing import NamedTuple

from umo.clients.fleet.run_words import Delta

MAX_DELTAS = 60
"""Largest number of deltas of one answer."""
MAX_DELTA_BYTES = 256 << 10
"""Size in bytes of an answer from which on no further delta is added."""


class KeptDelta(NamedTuple):
    """A delta that is kept: its number, whether it has all words, and the message."""

    number: int
    is_full: bool
    data: bytes


class KeptDeltas:
    """Keeps at least the last `count` deltas, beginning at a full one. Deltas are added and read by different
    threads."""

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
        """Return the number of the last delta (-1 if there is none), and as many of the deltas from `number` on as fit
        in one answer. If the first returned delta has a higher number than requested, the deltas before it are no
        longer kept."""
        with self._lock:
            last = self._kept[-1].number if self._kept else -1
            kept = list(takewhile(lambda each: each.number >= number, reversed(self._kept)))
        found: list[bytes] = []
        size = 0
        for each in reversed(kept):
            size += len(each.data)
            if found and (len(found) == MAX_DELTAS or size > MAX_DELTA_BYTES):
                break
            found.append(each.data)
        return last, found
