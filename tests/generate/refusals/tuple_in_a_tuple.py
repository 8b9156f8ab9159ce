"""Tuple in a tuple."""

from __future__ import annotations

from helpers.written_programs import Program


class TupleInATuple(Program):
    def control(self) -> None:
        # refused: `in` searches for a tuple; compare their elements
        self.yes = (self.n, self.c) in ((1, 2), (3, 4))
