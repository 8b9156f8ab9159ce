"""Records in memory that processes share. Other processes read each record either completely or not at all.

Neither Python nor numpy has memory barriers. On some processors (ARM) other processes may see stores in an order that
differs from that of the program. So they may see a number that says "complete" before they see the data. Therefore each
record has its number and a checksum (CRC-32) over number and content. With the checksum a reader checks its copy,
whatever the order in which it saw the stores. If a writer is killed or stopped during a write, the record remains
incomplete.
"""

from __future__ import annotations

import struct
import zlib
from mmap import mmap
from typing import Any

MASK = (1 << 64) - 1
HEAD = struct.Struct("<QQQ")
"""The head of a record: its number, the size of its content in bytes, the checksum."""


def checksum(content: bytes | memoryview, number: int) -> int:
    """Return the checksum of a record with this number."""
    return zlib.crc32(content, zlib.crc32(struct.pack("<Q", number & MASK)))


class SharedText:
    """A text at one place in shared memory. `room`: the size of the place in bytes, including the head of the record.
    Memory that cannot be written, such as that of a file, is only read."""

    def __init__(self, memory: mmap | bytearray | bytes, at: int, room: int) -> None:
        self._memory: Any = memory
        self._at, self._most = at, room - HEAD.size

    def put(self, number: int, text: bytes) -> None:
        """Write a text with this number. Raises ValueError if there is no room for it."""
        if len(text) > self._most:
            raise ValueError(f"{len(text)} bytes do not fit into {self._most}")
        start = self._at + HEAD.size
        self._memory[start : start + len(text)] = text
        self._memory[self._at : start] = HEAD.pack(number, len(text), checksum(text, number))

    def get(self) -> tuple[int, bytes] | None:
        """Return the text and its number; None while no record is complete."""
        start = self._at + HEAD.size
        number, size, proof = HEAD.unpack(bytes(self._memory[self._at : start]))
        if not proof or size > self._most:
            return None
        text = bytes(self._memory[start : start + size])
        return (number, text) if checksum(text, number) == proof else None
