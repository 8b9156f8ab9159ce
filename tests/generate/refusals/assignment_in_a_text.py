"""Assignment in a text."""

from __future__ import annotations

from helpers.written_programs import Program


class AssignmentInAText(Program):
    def control(self) -> None:
        # refused: an assignment in a text that a controller does not have; a line of its own
        print(f"{(last := self.u)}")
        self.k = 1.0
