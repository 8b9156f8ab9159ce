"""Tuple with a list in it."""

from __future__ import annotations

from helpers.written_programs import Program


class TupleWithAListInIt(Program):
    def found(self, given):
        return given[1]

    def control(self) -> None:
        # refused: the argument 'given' is not a value that a controller can hold
        self.k = self.found(((self.u, 1.0), self.k))
