"""The first one of several lists."""

from __future__ import annotations

from helpers.written_programs import Program


class FirstArray(Program):
    def begin(self) -> None:
        self.row, self.other = [1.0, 2.0], [3.0, 4.0]

    def control(self) -> None:
        # refused: the element found is a list or an array; one of its elements
        self.k = next((each for each in (self.row, self.other) if each[0] > self.u), self.row)[1]
