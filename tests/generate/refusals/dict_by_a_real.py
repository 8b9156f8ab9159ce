"""Dict by a real."""

from __future__ import annotations

from helpers.written_programs import Program

STEPS = {0: 5, 2: 7, -3: 1}


class DictByAReal(Program):
    def control(self) -> None:
        # refused: the key is not of the class of the dict's keys; members of one Enum, int
        self.c = STEPS[self.u]  # type: ignore[index]
