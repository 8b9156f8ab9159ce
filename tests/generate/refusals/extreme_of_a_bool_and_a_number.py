"""Extreme of a bool and a number."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeOfABoolAndANumber(Program):
    def control(self) -> None:
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(max(True, self.u))
