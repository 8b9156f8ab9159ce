"""Element of a tuple of several classes."""

from __future__ import annotations

from helpers.written_programs import Program


class ElementOfATupleOfSeveralClasses(Program):
    def control(self) -> None:
        # refused: an element of a tuple whose values are not of one class; one class for all
        self.k = (self.u, self.n)[self.n]
