"""A list and a tuple that are added."""

from __future__ import annotations

from helpers.written_programs import Program


class ListAndTupleThatAreAdded(Program):
    def control(self) -> None:
        # refused: a list and a tuple are added; two lists, two tuples
        self.k = sum([self.u] + (1.0, 2.0))
