"""Several elements are added to."""

from __future__ import annotations

from helpers.written_programs import Program


class SeveralElementsAreAddedTo(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: the slice is not that of an array; its elements, one by one
        self.row[0:2] += self.u
