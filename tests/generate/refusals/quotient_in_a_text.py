"""Quotient in a text."""

from __future__ import annotations

from helpers.written_programs import Program


class QuotientInAText(Program):
    def control(self) -> None:
        # refused: a quotient in a text that a controller does not have; a name for it first
        print(f"{self.u / self.k}")
