"""Shifted real."""

from __future__ import annotations

from helpers.written_programs import Program


class ShiftedReal(Program):
    def control(self) -> None:
        # refused: this arithmetic cannot be translated; +, -, *, /, //, %, **
        self.k = self.u @ self.u
