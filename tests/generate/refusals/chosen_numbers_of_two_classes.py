"""Numbers of two classes that conditions choose."""

from __future__ import annotations

from helpers.written_programs import Program


class ChosenNumbersOfTwoClasses(Program):
    def control(self) -> None:
        # refused: the number of elements is not known, and the elements are of several classes or of numpy; float(...)
        found = [each for each in (self.u, self.n) if each > 1.0]
        self.k = 1.0 if found else 0.0
