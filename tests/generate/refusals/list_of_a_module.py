"""List of a module."""

from __future__ import annotations

from helpers.written_programs import Program

ROW = [1.0, 2.0]


class ListOfAModule(Program):
    def begin(self) -> None:
        self.row = ROW

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.row[0] = self.u
        self.k = ROW[0] * 1.0
