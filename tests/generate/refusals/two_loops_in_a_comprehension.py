"""A list that two loops make."""

from __future__ import annotations

from helpers.written_programs import Program


class TwoLoopsInAComprehension(Program):
    def control(self) -> None:
        # refused: the expression has two loops; a loop for each
        self.k = [one * other for one in (self.u, 1.0) for other in (self.k, 2.0)][0]
