"""Whole number in a list of reals."""

from __future__ import annotations

from helpers.written_programs import Program


class WholeNumberInAListOfReals(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: an int is put into a list of floats; 0.0, float(...)
        self.row[0] = self.n
        self.k = -self.row[0]
