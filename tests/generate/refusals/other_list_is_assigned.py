"""Other list is assigned."""

from __future__ import annotations

from helpers.written_programs import Program


class OtherListIsAssigned(Program):
    def begin(self) -> None:
        self.row, self.other = [1.0, 2.0], [3.0, 4.0]

    def control(self) -> None:
        # refused: a list is assigned as a whole; its elements, one by one
        self.row = self.other
