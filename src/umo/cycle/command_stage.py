"""The command stage, which checks every write to a guarded actuator before the write reaches the process image.

    source, range, interlock, expiry, then the image

The object itself checks the range first. Only writes to actuators that are marked in the column `restrictions` reach
this stage. The claims (`claim_table.py`) set this column, and decide whether a write is accepted. All other writes go
directly into the image. The image limits the rate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from umo.cycle.claim_table import Claims
from umo.cycle.columns import Source
from umo.cycle.events import Event, Paths, of_several
from umo.cycle.image import Image
from umo.errors import Interlocked
from umo.objects import Atomic
from umo.objects.scaling import FloatArray
from umo.user_code import attempt

WriteWatch = Callable[[int, float, str, bool], object]
"""A function that is called for each write: with the slot, the value, the source, and whether it was accepted."""


class CommandStage:
    """The command stage of one connected machine."""

    def __init__(self, claims: Claims, image: Image) -> None:
        self._claims, self._image = claims, image
        self._by_slot = claims.by_slot
        self._watching: list[WriteWatch] = []
        self.noted: set[int] | None = None
        """The actuators that were written since `note_writes`; None if writes are not noted."""

    def accept(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """Handle a write within the range. Return True if the image accepts it, False if the actuator is inhibited."""
        if self.noted is not None:
            self.noted.add(slot)
        command, taken = self._by_slot.get(slot), False
        try:
            taken = command is None or command.admits(value, source)
        finally:
            self._tell(slot, value, source, taken)
        if command is not None and taken:
            command.written = self._image.clock.now
        return taken

    def accept_many(self, slots: Sequence[int], values: FloatArray) -> list[bool]:
        """Handle many writes in one call. Return one answer for each write. If the function raises Interlocked, no
        write was accepted."""
        if self.noted is not None:
            self.noted.update(slots)
        commands = [self._by_slot.get(slot) for slot in slots]
        numbers = values.tolist()
        free = [
            each is None or each.admits(value, Source.PROGRAM) for each, value in zip(commands, numbers, strict=True)
        ]
        if self._watching:
            for slot, value, taken in zip(slots, numbers, free, strict=True):
                self._tell(slot, value, Source.PROGRAM, taken)
        for command, admitted in zip(commands, free, strict=True):
            if command is not None and admitted:
                command.written = self._image.clock.now
        return free

    def go_on(self, left: Mapping[int, float]) -> None:
        """Write again the values that suspended work last wrote to these actuators. A value that is not accepted is
        recorded as an event."""
        image = self._image
        if refused := [slot for slot, value in left.items() if not self._goes_on(slot, value)]:
            image.events.add(partial(_not_restored, image.clock.now, image.items, refused), logged=True)

    def _goes_on(self, slot: int, value: float) -> bool:
        try:
            return self._image.go_on(slot, value)
        except Interlocked:  # whoever goes on has not written this: it is told
            return False

    def note_writes(self, yes: bool) -> None:
        """Start or stop noting in `noted` which actuators are written."""
        self.noted = set() if yes else None
        self._ask()

    def rest(self, slot: int) -> None:
        """Bring the actuator to its default."""
        if slot in self._by_slot:
            self._by_slot[slot].written = None
        if self._watching:
            self._tell(slot, float(self._image.scales.defaults[slot]), Source.DEFAULT, True)

    def _tell(self, slot: int, value: float, source: Source, taken: bool) -> None:
        """Call the watches. A watch that raises an error is reported and not called again, so that it cannot prevent a
        reset."""
        for watch in tuple(self._watching):
            _, error = attempt(watch, slot, value, source.value, taken)
            if error is not None:
                self._watching.remove(watch)
                text = f"a function that observes writes has failed, and is no longer called: {error.text}"
                self._image.events.add(Event(self._image.clock.now, "", text), logged=True)

    def watch(self, call: WriteWatch) -> None:
        """Call this function for each write and each default that is sent, with the slot, the value, the source
        ("program", "client", "default"), and whether the write was accepted. While there is such a function,
        every write passes this stage."""
        self._watching.append(call)
        self._ask()

    def end_watch(self, call: WriteWatch) -> None:
        """Do not call this function any more."""
        if call in self._watching:
            self._watching.remove(call)
        self._ask()

    def _ask(self) -> None:
        """Let all writes pass this stage while writes are watched or noted."""
        self._claims.ask_all(self.noted is not None or bool(self._watching))


def _not_restored(now: float, items: Sequence[Atomic], slots: Sequence[int]) -> Event:
    paths = Paths(items, slots)
    return of_several(now, paths, "not restored: it is inhibited", f"{len(paths):,} not restored: they are inhibited")
