"""Writes of control code into the image, by the extension in C (`writes.c`) if it is built. Besides the value, a write
stores its writer, and a bit until the values are sent. A function is called only if another writer than before writes
another value (`two_writers.py`). Without the extension only the value is stored, because the rest would double the
time; then writes are examined in some periods (`sampled_writes.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, cast

from umo.cycle import conversion
from umo.objects.scaling import FloatArray, IntArray

Changed = Callable[[Sequence[int], Sequence[float], Sequence[float]], None]
"""Function that is called before another writer than before writes these slots, with the pending values and the new
ones."""


class Turn(Protocol):
    """The code that is being carried out at this moment."""

    task: Any
    """The started sequence, or the one that it runs in parallel with others, or None if none does."""
    law: Any
    """The law that acts, or None if none does."""


class PlainTurn:
    """The `Turn` without the extension."""

    __slots__ = ("law", "task")

    def __init__(self) -> None:
        self.task: Any = None
        self.law: Any = None


class ImageWrites(Protocol):
    """Writes into the image."""

    def write(self, slot: int, value: float) -> bool:
        """Write a value within the range. Return True if it was accepted."""

    def write_many(self, slots: slice | IntArray, values: FloatArray) -> bool:
        """Write many values. If one of the actuators is restricted, nothing is written, and the result is False."""

    def note(self, slot: int, before: float, value: float) -> None:
        """Note a value that was accepted in another way; `before`: the pending value until then."""


def make_turn() -> Turn:
    extension = conversion.extension
    return PlainTurn() if extension is None else cast(Turn, extension.Turn())


def make_writes(
    restrictions: Any,
    pending: Any,
    written: Any,
    owners: Any,
    turn: Turn,
    command: Callable[[int, float], bool],
    changed: Changed,
) -> ImageWrites | None:
    """Make the writes of an image from its columns. `command` is called for restricted actuators. Returns None without
    the extension."""
    extension = conversion.extension
    if extension is None:
        return None
    return cast(ImageWrites, extension.Writes(restrictions, pending, written, owners, turn, command, changed))
