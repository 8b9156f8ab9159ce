"""Element of a number."""

from __future__ import annotations

from helpers.written_programs import Program


class ElementOfANumber(Program):
    def control(self) -> None:
        # refused: an element of something that is not a list of numbers
        self.k = self.u[0]
