"""Name of an object becomes a number."""

from __future__ import annotations

from helpers.written_programs import Program


class NameOfAnObjectBecomesANumber(Program):
    def control(self) -> None:
        if self.yes:
            # refused: 'which' means different objects; one name per object
            which = self.b
            which.write(1.0)
        else:
            which = self.u
            self.k = which
