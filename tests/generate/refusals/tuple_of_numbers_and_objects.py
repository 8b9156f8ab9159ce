"""Tuple of numbers and objects."""

from __future__ import annotations

from helpers.written_programs import Program


class TupleOfNumbersAndObjects(Program):
    def begin(self) -> None:
        self.pair = (1.0, 2.0)

    def control(self) -> None:
        # refused: self.pair is not a number or a state; numbers, states, tuples of these
        self.pair = (self.u, self.fan)
