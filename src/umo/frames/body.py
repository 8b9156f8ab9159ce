"""The body of a frame: all that follows `sequence` and `checksum`.

It is written in C where the extension is built, otherwise in Python. Tests prove that both write the same bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from mmap import mmap

from umo.cycle import conversion
from umo.cycle.image import Image
from umo.frames.layout import SELDOM, Layout

BODY = 16
"""Offset of the body in a frame."""


Write = Callable[[int, int, float, int, int, int, int, bytes, list[int], list[float]], None]
"""Writes one body, as `_Packed.write`."""


def writer(image: Image, layout: Layout, file: mmap) -> Write:
    """The quickest one. It may hold the file's memory as long as it exists."""
    shown = image.columns.shown
    if conversion.extension is not None:
        write: Write = conversion.extension.Body(file, shown, layout.content - BODY).write
        return write
    return _Packed(shown, layout, file).write


class _Packed:
    """The writer in Python."""

    def __init__(self, shown: memoryview, layout: Layout, file: mmap) -> None:
        self._shown, self._file = shown, file
        self._struct = struct.Struct(f"<qdqqqq{SELDOM.size}s{len(layout.phases)}q{len(layout.signals)}d")

    def write(
        self,
        at: int,
        number: int,
        time: float,
        missed: int,
        began: int,
        wake: int,
        execution: int,
        seldom: bytes,
        phases: list[int],
        signals: list[float],
    ) -> None:
        """Write a body to `at` in the file, with what the image shows. The arguments are of exactly these types; times
        but `time` are ns; `seldom` is what changes seldom, packed."""
        self._struct.pack_into(self._file, at, number, time, missed, began, wake, execution, seldom, *phases, *signals)
        end = at + self._struct.size
        self._file[end : end + len(self._shown)] = self._shown
