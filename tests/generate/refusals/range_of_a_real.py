"""Range of a real."""

from __future__ import annotations

from helpers.written_programs import Program


class RangeOfAReal(Program):
    def control(self) -> None:
        # refused: the range is not of integers; int(...)
        for each in range(2.5):
            self.c += each
