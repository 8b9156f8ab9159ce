"""List in a tuple."""

from __future__ import annotations

from helpers.written_programs import Program


class ListInATuple(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]
        self.both = (self.row, 2.0)

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.row[0] = self.u
        self.k = self.both[0][0] * 1.0
