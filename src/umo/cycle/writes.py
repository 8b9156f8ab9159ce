"""The writes of control code into the image, by the extension in C (`writes.c`) if the extension is built. In addition
to the value, a write stores its writer, and sets a bit until the values are sent. A function is called only if a writer
other than the previous one writes another value (`two_writers.py`). Without the extension only the value is stored,
because storing more would double the time. Writes are then examined only in some periods (`sampled_writes.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, cast

from umo.cycle import conversion
from umo.objects.scaling import FloatArray, IntArray

Changed = Callable[[Sequence[int], Sequence[float], Sequence[float]], None]
"""The function that is called with the pending and the new values before a writer other than the previous one writes
these slots."""


class CalledAction(NamedTuple):
    """An action that a client has called, as a writer. Writers are compared by identity."""

    path: str

    def __str__(self) -> str:
        return f"action {self.path}"


class Turn(Protocol):
    """The code that is now being carried out."""

    task: Any
    """The started sequence that takes a step, or the sequence that it runs in parallel with others; None if no sequence
    takes a step."""
    law: Any
    """The law that acts, or the `CalledAction` whose function is called; None if there is neither."""


class PlainTurn:
    """The `Turn` without the extension."""

    __slots__ = ("law", "task")

    def __init__(self) -> None:
        self.task: Any = None
        self.law: Any = None


class ImageWrites(Protocol):
    """The functions that write into the image."""

    def write(self, slot: int, value: float) -> bool:
        """Write a value within the range. Return True if it was accepted."""

    def write_many(self, slots: slice | IntArray, values: FloatArray) -> bool:
        """Write many values. If one of the actuators is restricted, nothing is written, and the result is False."""

    def note(self, slot: int, before: float, value: float) -> None:
        """Record a value that was accepted in another way. `before`: the pending value before this one."""


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
    """Return the writes of an image, made from its columns; None without the extension. `command` is called for
    restricted actuators."""
    extension = conversion.extension
    if extension is None:
        return None
    return cast(ImageWrites, extension.Writes(restrictions, pending, written, owners, turn, command, changed))
