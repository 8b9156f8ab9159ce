"""Attribute of a tuple is assigned."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float


class AttributeOfATupleIsAssigned(Program):
    def begin(self) -> None:
        self.pair = Pair(1.0)

    def control(self) -> None:
        # refused: the object of this attribute is not known when the code is generated
        self.pair.first = 1.0
