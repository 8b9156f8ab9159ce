"""Large number in a list."""

from __future__ import annotations

from helpers.written_programs import Program


class LargeNumberInAList(Program):
    def begin(self) -> None:
        self.row = [1, 2**40]

    def control(self) -> None:
        # refused: row has a number that does not fit 32 bits; smaller numbers, or floats
        self.k = self.row[1] * 1.0
