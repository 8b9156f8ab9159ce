"""Tuple without a field."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float
    second: float


class TupleWithoutAField(Program):
    def control(self) -> None:
        # refused: the arguments do not match the fields of Pair; first, second
        self.k = Pair(self.u).first
