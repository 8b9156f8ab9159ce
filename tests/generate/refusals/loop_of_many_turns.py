"""Loop of many turns."""

from __future__ import annotations

from helpers.written_programs import Program

OBJECTS = [(1, "x")] * 300


class LoopOfManyTurns(Program):
    def control(self) -> None:
        # refused: the loop over objects has 300 turns; at most 256, or a Vector
        for each in OBJECTS:
            self.c += each[0]
