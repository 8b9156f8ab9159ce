"""A whole number where a NamedTuple declares a float."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float
    second: float


class TupleOfAnotherClass(Program):
    def begin(self) -> None:
        self.pair = Pair(0, 1.0)

    def control(self) -> None:
        # refused: pair has a value of another class than Pair declares; 0.0 instead of 0, float(...)
        self.k = -self.pair.first
