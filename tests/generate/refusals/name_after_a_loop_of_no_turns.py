"""Name after a loop of no turns."""

from __future__ import annotations

from helpers.written_programs import Program


class NameAfterALoopOfNoTurns(Program):
    def control(self) -> None:
        for i in range(self.n % 4):
            last = i
        # refused: on some branches it has no value or another object; give it a value first, or use one name per object
        self.c = last
