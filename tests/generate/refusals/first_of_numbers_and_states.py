"""The first one of values of several types."""

from __future__ import annotations

from helpers.written_programs import Program


class FirstOfNumbersAndStates(Program):
    def control(self) -> None:
        # refused: the number of elements is not known, and the elements are of several classes or of numpy; float(...), one type for all
        self.yes = next((each.pending for each in (self.a, self.fan) if self.n > 1), 0.0) == 1.0
