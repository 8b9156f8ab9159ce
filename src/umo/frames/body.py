"""The body of a frame: all that follows `sequence` and `checksum`, written by a writer for each form of the image.

Tests prove that the writers write the same bytes. The one in C is used where the image has the compiled form.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from mmap import mmap

from umo.cycle.forms import ArrayImage, CompiledImage, form_for
from umo.cycle.image import Image
from umo.frames.layout import SELDOM, Layout

try:
    from umo.frames import _body as extension
except ImportError:  # it was not built
    extension = None  # type: ignore[assignment]
BODY = 16
"""Offset of the body in a frame."""


Write = Callable[[int, int, float, int, int, int, int, bytes, list[int], list[float], bytes], None]
"""Writes one body, as `_Packed.write`."""


def is_compiled() -> bool:
    """Whether the extensions in C are there, of the image and of the frames."""
    return extension is not None and form_for(1) is CompiledImage


def writer(image: Image, layout: Layout, file: mmap) -> Write:
    """The quickest one for this image. It may hold the file's memory as long as it exists."""
    if extension is not None and isinstance(image, CompiledImage):
        return extension.Body(file, image.values, image.raws, image.quality, layout.content - BODY).write
    return _Packed(image, layout, file).write


class _Packed:
    """The writer in Python."""

    def __init__(self, image: Image, layout: Layout, file: mmap) -> None:
        self._image, self._file = image, file
        self._arrays = isinstance(image, ArrayImage)
        count, signals = len(layout.objects), f"{len(layout.signals)}d"
        values = f"{8 * count}s" if self._arrays else f"{count}d"
        self._struct = struct.Struct(
            f"<qdqqqq{SELDOM.size}s{len(layout.phases)}q{signals}{values}{8 * count}s{2 * count}s"
        )

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
        commands: bytes,
    ) -> None:
        """To `at` in the file, with the values, raw integers and qualities of the image. Of exactly these types; times
        but `time` are ns; `seldom` is what changes seldom, packed; `commands` has a byte for each object."""
        image = self._image
        values = (image.values.tobytes(),) if self._arrays else image.values
        rest = *values, image.raws.tobytes(), bytes(image.quality) + commands
        numbers = number, time, missed, began, wake, execution
        self._struct.pack_into(self._file, at, *numbers, seldom, *phases, *signals, *rest)
