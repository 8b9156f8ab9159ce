"""Tuples of reals."""

from __future__ import annotations

from helpers.written_programs import Program


class TuplesOfReals(Program):
    def control(self) -> None:
        # refused: tuples of floats are compared; compare their elements
        self.yes = (self.u, self.k) == (1.0, 2.0)
