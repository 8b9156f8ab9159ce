"""Table at a real place."""

from __future__ import annotations

from helpers.written_programs import Program

GAINS = (0.5, -1.0, 4.0)


class TableAtARealPlace(Program):
    def control(self) -> None:
        # refused: a place in a table is a whole number
        self.k = GAINS[self.u]  # type: ignore[index]
