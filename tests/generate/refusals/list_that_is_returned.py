"""List that is returned."""

from __future__ import annotations

from helpers.written_programs import Program


class ListThatIsReturned(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def found(self) -> list[float]:
        return self.row

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.found()[0] = self.u
        self.k = self.row[0] * 1.0
