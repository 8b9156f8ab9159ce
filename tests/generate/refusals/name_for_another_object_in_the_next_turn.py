"""Name for another object in the next turn."""

from __future__ import annotations

from helpers.written_programs import Program


class NameForAnotherObjectInTheNextTurn(Program):
    def control(self) -> None:
        which = self.a
        while self.c < 3:
            # refused: 'which' means another object in the next turn; one name per object
            which.write(1.0)
            which = self.b
            self.c += 1
