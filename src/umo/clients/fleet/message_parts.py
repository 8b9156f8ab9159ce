"""Several parts in one message: first the number of parts and the size of each (`<u4`), then the parts."""

from __future__ import annotations

import struct

from umo.errors import FramesError

MAX_PARTS = 64


def packed(*parts: bytes) -> bytes:
    return b"".join((struct.pack(f"<{1 + len(parts)}I", len(parts), *map(len, parts)), *parts))


def unpacked(data: bytes) -> list[bytes]:
    """Return the parts of a message. Raises FramesError if it is incomplete."""
    try:
        (count,) = struct.unpack_from("<I", data)
        if count > MAX_PARTS:
            raise ValueError(f"{count} parts")
        sizes = struct.unpack_from(f"<{count}I", data, 4)
        if 4 + 4 * count + sum(sizes) != len(data):
            raise ValueError(f"{len(data)} bytes")
    except (struct.error, ValueError) as error:
        raise FramesError(f"a message is incomplete: {error}") from None
    found, at = [], 4 + 4 * count
    for size in sizes:
        found.append(data[at : at + size])
        at += size
    return found
