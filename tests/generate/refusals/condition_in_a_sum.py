"""Condition in a sum."""

from __future__ import annotations

from helpers.written_programs import Program


class ConditionInASum(Program):
    def control(self) -> None:
        # refused: the number of elements is not known, and the elements are of several classes or of numpy; float(...)
        self.k = sum(each for each in (self.u, self.k) if each > 1.0)
