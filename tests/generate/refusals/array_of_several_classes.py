"""Array of several classes."""

from __future__ import annotations

from helpers.written_programs import Program


class ArrayOfSeveralClasses(Program):
    def begin(self) -> None:
        self.row = [1.0, True, 2]

    def control(self) -> None:
        # refused: a table whose values are not numbers, states or tuples of one class; 0.0 instead of 0, one class for all elements
        self.k = self.row[self.n]
