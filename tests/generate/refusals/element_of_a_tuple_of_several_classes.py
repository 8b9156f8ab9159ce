"""Element of a tuple of several classes."""

from __future__ import annotations

from helpers.written_programs import Program


class ElementOfATupleOfSeveralClasses(Program):
    def control(self) -> None:
        # refused: the tuple has values of several classes; one class for all elements
        self.k = (self.u, self.n)[self.n]
