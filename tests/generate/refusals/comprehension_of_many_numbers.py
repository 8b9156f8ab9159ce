"""A comprehension of many elements."""

from __future__ import annotations

from helpers.written_programs import Program


class ComprehensionOfManyNumbers(Program):
    def control(self) -> None:
        # refused: the expression has 300 numbers; at most 256, or a loop
        self.c = sum([i + self.c for i in range(300)])
