"""Real place."""

from __future__ import annotations

from helpers.written_programs import Program


class RealPlace(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: an index into a list must be an integer
        self.k = self.row[self.u]
