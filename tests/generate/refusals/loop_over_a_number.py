"""Loop over a number."""

from __future__ import annotations

from helpers.written_programs import Program


class LoopOverANumber(Program):
    def control(self) -> None:
        # refused: the elements of the loop are not known when the code is generated; a list of parts, range
        for each in self.u:
            self.k = each
