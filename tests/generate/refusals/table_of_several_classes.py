"""Table of several classes."""

from __future__ import annotations

from helpers.written_programs import Program

MIXED = (1, 2.5)


class TableOfSeveralClasses(Program):
    def control(self) -> None:
        # refused: a table whose values are not numbers, states or tuples of one class; 0.0 instead of 0, one class for all elements
        self.k = MIXED[self.n % 2] * 1.0
