"""A sum of whole numbers and floats that have to fulfil a condition."""

from __future__ import annotations

from helpers.written_programs import Program


class SumOfSeveralClasses(Program):
    def control(self) -> None:
        # refused: the number of elements is not known, and the elements are of several classes or of numpy; float(...)
        self.k = sum(each for each in (self.u, self.n) if each > 1)
