"""Condition in a sum."""

from __future__ import annotations

from helpers.written_programs import Program


class ConditionInASum(Program):
    def control(self) -> None:
        # refused: elements of several classes, or of numpy, of which the number is not known; float(...)
        self.k = sum(each for each in (self.u, self.k) if each > 1.0)
