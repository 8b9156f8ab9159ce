"""Name after a while of no turns."""

from __future__ import annotations

from helpers.written_programs import Program


class NameAfterAWhileOfNoTurns(Program):
    def control(self) -> None:
        i = self.n % 4
        while i > 0:
            last = i
            i -= 1
        # refused: it is used before it has a value on every way; give it a value first
        self.c = last
