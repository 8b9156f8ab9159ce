"""Product of whole or real."""

from __future__ import annotations

from helpers.written_programs import Program


class ProductOfWholeOrReal(Program):
    def control(self) -> None:
        best = 0
        if self.u > 1.0:
            best = self.u
        # refused: the number may be an int or a float; 0.0 instead of 0, float(...)
        self.k = best * self.n
