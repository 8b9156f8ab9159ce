"""Tuple with too many names."""

from __future__ import annotations

from helpers.written_programs import Program


class TupleWithTooManyNames(Program):
    def control(self) -> None:
        # refused: 3 values for 2 names
        one, two = self.u, self.k, 1.0
        self.k = one + two
