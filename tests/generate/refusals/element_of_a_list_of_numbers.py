"""Element of a list of numbers."""

from __future__ import annotations

from helpers.written_programs import Program


class ElementOfAListOfNumbers(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: `in` of something that is not known when the code is generated; a tuple
        self.yes = 1.0 in self.row
