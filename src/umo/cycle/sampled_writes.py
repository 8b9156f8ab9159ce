"""The detection of the code that writes the actuators, for use without the extension in C. The writes are examined only
in some periods (decision 105).

In these periods every write passes the command stage, which reports it. In all other periods nothing is checked, which
takes no time. An error that occurs in every period is found; an error that occurs once may be missed."""

from __future__ import annotations

from typing import Any

from umo.cycle.columns import LAST, NOW, TOLD, UNSEEN, Source
from umo.cycle.command_stage import CommandStage
from umo.cycle.image import Image
from umo.cycle.writes import Changed, Turn

FIRST, LOOKED_AT, OF = 10, 3, 1000
"""FIRST: the number of the first period in which writes are examined. LOOKED_AT: the number of consecutive periods that
are examined. OF: the number of periods from one examination to the next."""


class SampledWrites:
    """The facts that the extension collects for every write, collected in some periods only."""

    def __init__(self, image: Image, commands: CommandStage, turn: Turn, changed: Changed) -> None:
        """`changed`: the function that is called before a writer other than the last one writes another value."""
        self._image, self._commands, self._turn, self._changed = image, commands, turn, changed
        self._written: Any = image.columns.written.data
        self._owners: dict[int, Any] = {}
        """The last writer of each actuator since the observation of writes began."""
        self._looks = False

    def begin_period(self) -> None:
        """Begin a period. Called in each period, before laws and sequences."""
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
        """Record a write before it is made."""
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
