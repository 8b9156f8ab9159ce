"""Whole number in a list of bools."""

from __future__ import annotations

from helpers.written_programs import Program


class WholeNumberInAListOfBools(Program):
    def begin(self) -> None:
        self.marks = [True, False]

    def control(self) -> None:
        # refused: a whole number where a bool was before; bool(...), or a whole number from the start
        self.marks[0] = self.n  # type: ignore[call-overload]
        self.c = self.marks[0] + 1
