"""Assignment in a generator."""

from __future__ import annotations

from helpers.written_programs import Program


class AssignmentInAGenerator(Program):
    def control(self) -> None:
        # refused: an assignment in a generator; a loop
        self.yes = any((last := each) > 1.0 for each in (self.u, self.k))
        self.k = last
