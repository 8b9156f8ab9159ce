"""A slice whose length is computed."""

from __future__ import annotations

from helpers.written_programs import Program


class SliceWithComputedEnds(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: the ends of the slice are not known; numbers, or a loop
        self.k = sum(self.row[self.n :])
