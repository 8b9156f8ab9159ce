"""Element of a number."""

from __future__ import annotations

from helpers.written_programs import Program


class ElementOfANumber(Program):
    def control(self) -> None:
        # refused: this is an element of something that is not a list or an array in C; a list of floats or of ints, np.zeros(n)
        self.k = self.u[0]
