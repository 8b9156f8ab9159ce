"""List of several classes."""

from __future__ import annotations

from helpers.written_programs import Program


class ListOfSeveralClasses(Program):
    def begin(self) -> None:
        self.row = [1.0, 2, 3.0]

    def control(self) -> None:
        # refused: this is an element of something that is not a list or an array in C; a list of floats or of ints, np.zeros(n)
        self.row[0] = self.u
