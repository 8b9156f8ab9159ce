"""Negative of whole or real."""

from __future__ import annotations

from helpers.written_programs import Program


class NegativeOfWholeOrReal(Program):
    def control(self) -> None:
        # refused: the number may be an int or a float; 0.0 instead of 0, float(...)
        self.k = -max(0, self.u)
