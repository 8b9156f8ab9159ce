"""Name after a while of no turns."""

from __future__ import annotations

from helpers.written_programs import Program


class NameAfterAWhileOfNoTurns(Program):
    def control(self) -> None:
        i = self.n % 4
        while i > 0:
            last = i
            i -= 1
        # refused: on some branches it has no value or another object; give it a value first, or use one name per object
        self.c = last
