"""Negative of whole or real."""

from __future__ import annotations

from helpers.written_programs import Program


class NegativeOfWholeOrReal(Program):
    def control(self) -> None:
        # refused: it may be a whole number at one time and a float at another; 0.0 in the place of 0, float(...)
        self.k = -max(0, self.u)
