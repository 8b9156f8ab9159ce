"""The asynchronous traffic of one period, in order, so that a replay can be exact."""

from __future__ import annotations

import struct
from enum import IntEnum

ENTRY = struct.Struct("=IIqq")
"""Slot, kind, raw, raw before: 24 bytes."""


class Kind(IntEnum):
    """What happened to an object between two transfers of the whole machine."""

    READ = 0
    WRITE = 1
    FAILED_READ = 2
    FAILED_WRITE = 3
    RESET = 4
    FAILED_RESET = 5
    EXPIRED = 6
    INTERLOCKED = 7
    INITIALIZE = 8


class Journal:
    """Reads and writes of asynchronous objects, and resets; the first `capacity` of a period, the rest are counted.

    The timer's own reads are not kept: `missed` says the same.
    """

    def __init__(self, capacity: int = 32) -> None:
        self.capacity = capacity
        self.buffer = bytearray(capacity * ENTRY.size)
        self.count = 0
        self.lost = 0
        self.sampled = self.updated = -1

    def add(self, slot: int, kind: Kind, raw: int, before: int) -> None:
        if self.count == self.capacity:
            self.lost += 1
            return
        ENTRY.pack_into(self.buffer, self.count * ENTRY.size, slot, kind, raw, before)
        self.count += 1

    def clear(self) -> None:
        self.count = self.lost = 0
        self.sampled = self.updated = -1
