"""Bool in a list of numbers."""

from __future__ import annotations

from helpers.written_programs import Program


class BoolInAListOfNumbers(Program):
    def begin(self) -> None:
        self.counts = [0, 0]

    def control(self) -> None:
        # refused: a bool is put into a list of numbers; int(...)
        self.counts[0] = self.u > 2.0
        self.a.write(self.counts[0])
