"""What control code writes to actuators goes into the image by the extension in C (`writes.c`), where it is built.

Beside a value, a write leaves who has written it, and a bit that says so until the values are sent. Only where another
one than before writes another value anything is called (`two_writers.py`). Without the extension only the value is
stored, as the rest would take as long again; in some periods writes are looked at (`sampled_writes.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, cast

from umo.cycle import conversion
from umo.objects.scaling import FloatArray, IntArray

Changed = Callable[[Sequence[int], Sequence[float], Sequence[float]], None]
"""Function that is called before another one than before writes these slots: with what is pending, and the values."""


class Turn(Protocol):
    """The code that takes a step at this moment."""

    task: Any
    """The started sequence, or the one that it runs in parallel with others, or None if none does."""
    law: Any
    """The law that acts, or None if none does."""


class PlainTurn:
    """The turn without the extension."""

    __slots__ = ("law", "task")

    def __init__(self) -> None:
        self.task: Any = None
        self.law: Any = None


class ImageWrites(Protocol):
    """Writes into the image."""

    def write(self, slot: int, value: float) -> bool:
        """True if a value within the range was taken."""

    def write_many(self, slots: slice | IntArray, values: FloatArray) -> bool:
        """Write many values, unless one of them is restricted: then nothing is done, and the result is False."""

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
    """From columns of the image. `command`: called for what is restricted. None: without the extension."""
    extension = conversion.extension
    if extension is None:
        return None
    return cast(ImageWrites, extension.Writes(restrictions, pending, written, owners, turn, command, changed))
