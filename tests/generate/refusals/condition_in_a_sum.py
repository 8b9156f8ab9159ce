"""Condition in a sum."""

from __future__ import annotations

from helpers.written_programs import Program


class ConditionInASum(Program):
    def control(self) -> None:
        # refused: `if` in a sum; a loop
        self.k = sum(each for each in (self.u, self.k) if each > 1.0)
