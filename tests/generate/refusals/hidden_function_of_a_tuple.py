"""A function that a NamedTuple has of itself."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float
    second: float


class HiddenFunctionOfATuple(Program):
    def begin(self) -> None:
        self.pair = Pair(0.0, 1.0)

    def control(self) -> None:
        self.pair = Pair(self.u, 1.0)
        # refused: the attribute '_asdict' of a Pair cannot be translated; a field, a property, a method
        self.k = self.pair._asdict()["first"]
