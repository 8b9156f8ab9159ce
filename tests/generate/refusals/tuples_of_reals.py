"""Tuples of reals."""

from __future__ import annotations

from helpers.written_programs import Program


class TuplesOfReals(Program):
    def control(self) -> None:
        # refused: a comparison of tuples of floats; compare their elements
        self.yes = (self.u, self.k) == (1.0, 2.0)
