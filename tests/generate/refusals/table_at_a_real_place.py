"""Table at a real place."""

from __future__ import annotations

from helpers.written_programs import Program

GAINS = (0.5, -1.0, 4.0)


class TableAtARealPlace(Program):
    def control(self) -> None:
        # refused: an index into a table must be an integer
        self.k = GAINS[self.u]  # type: ignore[index]
