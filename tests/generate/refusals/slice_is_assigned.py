"""Slice is assigned."""

from __future__ import annotations

from helpers.written_programs import Program


class SliceIsAssigned(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: this does not translate; numbers, states, comparisons, arithmetic, calls of functions
        self.row[0:2] = (1.0, 2.0)
