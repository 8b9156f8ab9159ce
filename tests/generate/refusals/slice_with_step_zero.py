"""A slice whose step is 0."""

from __future__ import annotations

from helpers.written_programs import Program


class SliceWithStepZero(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: the step of the slice is 0; another step
        self.k = sum(self.row[::0])
