"""Starred number."""

from __future__ import annotations

from helpers.written_programs import Program


class StarredNumber(Program):
    def control(self) -> None:
        # refused: the number of its elements is not known
        self.k = max(*self.u)
