"""Name for another object in the next turn."""

from __future__ import annotations

from helpers.written_programs import Program


class NameForAnotherObjectInTheNextTurn(Program):
    def control(self) -> None:
        which = self.a
        while self.c < 3:
            # refused: 'which' stands for another object in the next turn; a name for each
            which.write(1.0)
            which = self.b
            self.c += 1
