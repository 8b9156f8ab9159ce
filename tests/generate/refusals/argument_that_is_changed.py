"""Argument that is changed."""

from __future__ import annotations

from helpers.written_programs import Program


class ArgumentThatIsChanged(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def bump(self) -> None:
        self.row[0] += 1.0

    def first(self, row: list[float]) -> float:
        self.bump()
        return row[0]

    def control(self) -> None:
        # refused: the function changes an array that also has another name in it; a copy
        self.k = self.first(self.row)
