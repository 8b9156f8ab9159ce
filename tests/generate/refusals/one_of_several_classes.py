"""A number of one object, and a state of another."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class OddPart:
    def __init__(self, value: Any) -> None:
        self.value = value


class OneOfSeveralClasses(Program):
    def begin(self) -> None:
        self.parts = OddPart(1.0), OddPart(self.fan.states.ON)
        self.last: Any = None

    def control(self) -> None:
        # refused: the objects have values of different types; one type
        self.k = self.parts[self.n].value
