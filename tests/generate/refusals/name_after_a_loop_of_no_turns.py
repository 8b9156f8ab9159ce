"""Name after a loop of no turns."""

from __future__ import annotations

from helpers.written_programs import Program


class NameAfterALoopOfNoTurns(Program):
    def control(self) -> None:
        for i in range(self.n % 4):
            last = i
        # refused: it is used before it has a value on every way; give it a value first
        self.c = last
