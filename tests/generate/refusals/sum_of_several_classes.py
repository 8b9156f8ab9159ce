"""A sum of whole numbers and floats that have to fulfil a condition."""

from __future__ import annotations

from helpers.written_programs import Program


class SumOfSeveralClasses(Program):
    def control(self) -> None:
        # refused: elements of several classes, or of numpy, of which the number is not known; float(...)
        self.k = sum(each for each in (self.u, self.n) if each > 1)
