"""Sorted numbers of two classes."""

from __future__ import annotations

from helpers.written_programs import Program


class SortedValuesOfTwoClasses(Program):
    def control(self) -> None:
        # refused: `sorted` is applied to something other than 1 to 64 numbers of one class; float(...), a loop
        self.k = sorted([self.u, self.n])[0] * 1.0
