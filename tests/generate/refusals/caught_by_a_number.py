"""Caught by a number."""

from __future__ import annotations

from helpers.written_programs import Program


class CaughtByANumber(Program):
    def control(self) -> None:
        try:
            self.k = 1.0 / self.u
        # refused: the caught class is not a class of errors; ZeroDivisionError, RangeError, ...
        except self.u:
            self.k = 0.0
