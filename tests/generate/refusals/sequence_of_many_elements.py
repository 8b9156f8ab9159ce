"""A sequence with many elements."""

from __future__ import annotations

from helpers.written_programs import Program


class SequenceOfManyElements(Program):
    def control(self) -> None:
        # refused: the sequence has more than 256 elements; a shorter one, an array
        self.k = max([self.u] * 300)
