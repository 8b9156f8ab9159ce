"""Loop is left in try."""

from __future__ import annotations

from helpers.written_programs import Program


class LoopIsLeftInTry(Program):
    def control(self) -> None:
        for each in (1.0, 2.0):
            try:
                self.k = each / self.u
                # refused: the loop jumps out of a `try`; a flag
                break
            except ZeroDivisionError:
                self.k = 0.0
