"""Frames of the link between host and controller. A frame is a body with its CRC-32, encoded without zeros (COBS),
between two zeros. `umo_frames.c` has the same code in C; docs/split-protocol.md describes the frames.
"""

from __future__ import annotations

from zlib import crc32

CRC_BYTES = 4
"""Number of bytes of the CRC-32, which follows a body with the least significant byte first."""
_LONGEST_RUN = 254
"""Largest number of bytes other than zero that one code of COBS stands for."""


def framed(body: bytes) -> bytes:
    """Return the bytes of a frame on the line. The zero before the frame ends any preceding noise."""
    return b"\0" + without_zeros(body + crc32(body).to_bytes(CRC_BYTES, "little")) + b"\0"


def without_zeros(data: bytes) -> bytes:
    """Encode by consistent overhead byte stuffing (Cheshire and Baker, 1999): each zero becomes the distance to the
    next one."""
    out, runs = bytearray(), data.split(b"\0")
    for number, run in enumerate(runs):
        while len(run) > _LONGEST_RUN or (len(run) == _LONGEST_RUN and number < len(runs) - 1):
            out += b"\xff" + run[:_LONGEST_RUN]
            run = run[_LONGEST_RUN:]
        out += bytes((len(run) + 1,)) + run
    return bytes(out)


def with_zeros(data: bytes) -> bytes | None:
    """Return the decoded bytes, or None if the distances do not fit."""
    out, at = bytearray(), 0
    while at < len(data):
        end = at + data[at]
        if data[at] == 0 or end > len(data):
            return None
        out += data[at + 1 : end]
        if data[at] <= _LONGEST_RUN and end < len(data):
            out.append(0)
        at = end
    return bytes(out)


class FrameReader:
    """Reads bytes from the line and returns the bodies of complete, undamaged frames."""

    def __init__(self, longest: int) -> None:
        self._longest = longest + longest // _LONGEST_RUN + 1 + CRC_BYTES
        self._data = bytearray()
        self._skips = False
        """True if a frame that is too long has begun: it is left out up to its end."""
        self.damaged = 0
        """Number of frames that were incomplete, or whose CRC-32 was wrong."""

    def take(self, data: bytes) -> list[bytes]:
        """Take bytes from the line, and return the bodies of the frames that end in them."""
        *ends, rest = data.split(b"\0")
        found = []
        for each in ends:
            self._add(each)
            if (body := self._end()) is not None:
                found.append(body)
        self._add(rest)
        return found

    def _add(self, piece: bytes) -> None:
        self._skips = self._skips or len(self._data) + len(piece) > self._longest
        if not self._skips:
            self._data += piece

    def _end(self) -> bytes | None:
        """Return the body of the frame that ends here, or None."""
        data, skipped = bytes(self._data), self._skips
        self._data.clear()
        self._skips = False
        if not data and not skipped:
            return None  # two zeros in a row
        found = None if skipped else with_zeros(data)
        if found is not None and len(found) > CRC_BYTES:
            body = found[:-CRC_BYTES]
            if crc32(body).to_bytes(CRC_BYTES, "little") == found[-CRC_BYTES:]:
                return body
        self.damaged += 1
        return None
