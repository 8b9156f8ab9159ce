"""What control code writes to actuators goes into the image here: by the extension in C (`writes.c`) where it is built,
otherwise by the classes below, which do the same.

Beside a value, a write leaves who has written it, and a bit that says so until the values are sent. Only where another
one than before writes another value anything is called (`two_writers.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, cast

from umo.cycle import conversion
from umo.cycle.columns import NOW, TOLD
from umo.objects.scaling import FloatArray, IntArray

Changed = Callable[[Sequence[int], Sequence[float], Sequence[float]], None]
"""Function that is called before another one than before writes these slots: with what is pending, and the values."""


class Turn(Protocol):
    """Who takes a step at this moment."""

    task: Any
    """The started sequence, or the one that it runs in parallel with others; None: none does."""
    law: Any
    """The law that acts; None: none does."""


class PlainTurn:
    """The same without the extension."""

    __slots__ = ("law", "task")

    def __init__(self) -> None:
        self.task: Any = None
        self.law: Any = None


class ImageWrites(Protocol):
    """The way of what is written into the image."""

    def write(self, slot: int, value: float) -> bool:
        """Whether a value within the range was taken."""

    def write_many(self, slots: slice | IntArray, values: FloatArray) -> bool:
        """The same of many, unless one of them is restricted: then nothing is done, and the result is False."""

    def note(self, slot: int, before: float, value: float) -> None:
        """A value was taken in another way; `before`: what was pending."""


class PlainWrites:
    """The same without the extension."""

    def __init__(
        self,
        restrictions: Any,
        pending: Any,
        written: Any,
        owners: Any,
        turn: Turn,
        command: Callable[[int, float], bool],
        changed: Changed,
    ) -> None:
        self._restrictions, self._pending, self._written = restrictions, pending, written
        self._owners: list[Any] = [self] * len(owners)
        """Who has written each last; here: nobody has."""
        self._turn, self._command, self._changed = turn, command, changed

    def write(self, slot: int, value: float) -> bool:
        before = self._pending[slot]
        if self._restrictions[slot]:
            taken = self._command(slot, value)
            if taken:
                self.note(slot, before, value)
            return taken
        self.note(slot, before, value)
        self._pending[slot] = value
        return True

    def write_many(self, slots: slice | IntArray, values: FloatArray) -> bool:
        each = range(len(self._owners))[slots] if isinstance(slots, slice) else slots.tolist()
        if any(self._restrictions[slot] for slot in each):
            return False
        owner, owners, written, pending = self._owner, self._owners, self._written, self._pending
        numbers = values.tolist()
        pairs = [
            (slot, value)
            for slot, value in zip(each, numbers, strict=True)
            if owners[slot] is owner or pending[slot] != value
        ]
        new = [pair for pair in pairs if owners[pair[0]] is not owner and written[pair[0]] < TOLD]
        if new:
            self._changed([slot for slot, _ in new], [pending[slot] for slot, _ in new], [value for _, value in new])
        for slot, _ in pairs:
            owners[slot] = owner
            written[slot] |= NOW
        for slot, value in zip(each, numbers, strict=True):
            pending[slot] = value  # 0.0 and -0.0 are equal
        return True

    def note(self, slot: int, before: float, value: float) -> None:
        owner = self._owner
        if self._owners[slot] is not owner:
            if before == value:
                return
            if self._written[slot] < TOLD:
                self._changed([slot], [before], [value])
            self._owners[slot] = owner
        self._written[slot] |= NOW

    @property
    def _owner(self) -> Any:
        turn = self._turn
        return turn.law if turn.task is None else turn.task


def make_turn() -> Turn:
    extension = conversion.extension
    return PlainTurn() if extension is None else cast(Turn, extension.Turn())


def make_writes(*arguments: Any) -> ImageWrites:
    extension = conversion.extension
    return PlainWrites(*arguments) if extension is None else cast(ImageWrites, extension.Writes(*arguments))
