"""Two loops in one expression."""

from __future__ import annotations

from helpers.written_programs import Program


class TwoLoopsInOneExpression(Program):
    def control(self) -> None:
        # refused: two loops in one expression; a loop for each
        self.yes = any(a > b for a in (self.u, self.k) for b in (1.0, 2.0))
