"""Tuple without a field."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float
    second: float


class TupleWithoutAField(Program):
    def control(self) -> None:
        # refused: it does not give the fields of Pair; first, second
        self.k = Pair(self.u).first
