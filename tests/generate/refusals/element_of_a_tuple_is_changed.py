"""Element of a tuple is changed."""

from __future__ import annotations

from helpers.written_programs import Program


class ElementOfATupleIsChanged(Program):
    def begin(self) -> None:
        self.pair = (1.0, 2.0)

    def control(self) -> None:
        # refused: this is an element of something that is not a list or an array in C; a list of floats or of ints, np.zeros(n)
        self.pair[0] += 1.0
