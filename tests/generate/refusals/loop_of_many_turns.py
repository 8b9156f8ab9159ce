"""Loop of many turns."""

from __future__ import annotations

from helpers.written_programs import Program

OBJECTS = [(1, "x")] * 300


class LoopOfManyTurns(Program):
    def control(self) -> None:
        # refused: a loop of 300 turns over objects; at most 256, or a Vector
        for each in OBJECTS:
            self.c += each[0]
