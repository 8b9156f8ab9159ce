"""Result with a whole or real number."""

from __future__ import annotations

from helpers.written_programs import Program


class ResultWithAWholeOrRealNumber(Program):
    def found(self):
        # refused: the tuple has a number that may be an int or a float; 0.0, float(...)
        return max(0, self.u), 1.0

    def control(self) -> None:
        # refused: NoneType defines its elements itself; a list, a tuple
        self.k = self.found()[0]
