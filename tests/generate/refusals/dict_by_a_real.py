"""Dict by a real."""

from __future__ import annotations

from helpers.written_programs import Program

STEPS = {0: 5, 2: 7, -3: 1}


class DictByAReal(Program):
    def control(self) -> None:
        # refused: the key of a dict that is not of the class of all its keys; members of one Enum, int
        self.c = STEPS[self.u]  # type: ignore[index]
