"""Product of whole or real."""

from __future__ import annotations

from helpers.written_programs import Program


class ProductOfWholeOrReal(Program):
    def control(self) -> None:
        best = 0
        if self.u > 1.0:
            best = self.u
        # refused: it may be a whole number at one time and a float at another; 0.0 in the place of 0, float(...)
        self.k = best * self.n
