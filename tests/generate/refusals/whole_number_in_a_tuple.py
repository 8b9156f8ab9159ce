"""Whole number in a tuple."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float
    second: float


class WholeNumberInATuple(Program):
    def begin(self) -> None:
        self.pair = Pair(0.0, 0.0)

    def control(self) -> None:
        # refused: an int takes the place of a float in the tuple; 0.0, float(...)
        self.pair = Pair(self.n, self.u)
        self.k = -self.pair.first
