"""Bools and numbers in a list."""

from __future__ import annotations

from helpers.written_programs import Program


class BoolsAndNumbersInAList(Program):
    def begin(self) -> None:
        self.row = [True, 2]

    def control(self) -> None:
        # refused: this is an element of something that is not a list or an array in C; a list of floats or of ints, np.zeros(n)
        self.row[0] = self.n
        self.a.write(self.row[0])
