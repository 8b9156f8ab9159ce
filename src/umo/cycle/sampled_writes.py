"""Who writes the actuators, looked at without the extension in C: in some periods (decision 105).

In these periods every write passes the command stage, which tells of it; in all others nothing is asked for, and
nothing costs anything. What goes wrong in each period is found, what happens once may not be.
"""

from __future__ import annotations

from typing import Any

from umo.cycle.columns import LAST, NOW, TOLD, UNSEEN, Source
from umo.cycle.command_stage import CommandStage
from umo.cycle.image import Image
from umo.cycle.writes import Changed, Turn

FIRST, LOOKED_AT, OF = 10, 3, 1000
"""The number of the first period in which writes are looked at; how many in a row are, of how many."""


class SampledWrites:
    """What the extension knows of every write, known of those in some periods."""

    def __init__(self, image: Image, commands: CommandStage, turn: Turn, changed: Changed) -> None:
        """`changed`: called before another one than before writes another value."""
        self._image, self._commands, self._turn, self._changed = image, commands, turn, changed
        self._written: Any = image.columns.written.data
        self._owners: dict[int, Any] = {}
        """Who has written each actuator last, since the writes are looked at."""
        self._looks = False

    def begin_period(self) -> None:
        """Called in each period, before laws and sequences."""
        looks = (self._image.clock.number - FIRST) % OF < LOOKED_AT
        if looks or self._looks:
            self._go_on(looks)

    def _go_on(self, looks: bool) -> None:
        for slot in self._owners:
            written = self._written[slot]
            self._written[slot] = (written & (TOLD | UNSEEN)) | (LAST if looks and written & NOW else 0)
        if looks is not self._looks:
            self._looks = looks
            self._owners.clear()
            (self._commands.watch if looks else self._commands.end_watch)(self._note)

    def _note(self, slot: int, value: float, source: str, taken: bool) -> None:
        """One is about to be written."""
        if not taken or source != Source.PROGRAM.value:
            return
        turn, before = self._turn, self._image.pending[slot]
        who = turn.law if turn.task is None else turn.task
        if self._owners.get(slot, self) is not who:
            if before == value:
                self._written[slot] |= UNSEEN
            elif self._written[slot] < TOLD:
                self._changed([slot], [before], [value])
            self._owners[slot] = who
        self._written[slot] |= NOW
