"""Name after a loop of no turns."""

from __future__ import annotations

from helpers.written_programs import Program


class NameAfterALoopOfNoTurns(Program):
    def control(self) -> None:
        for i in range(self.n % 4):
            last = i
        # refused: on some ways it has no value, or another object; give it a value first, a name for each object
        self.c = last
