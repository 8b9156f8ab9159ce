"""One of a number and a state."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class OneOfANumberAndAState(Program):
    def begin(self) -> None:
        self.last = 1.0

    def control(self) -> None:
        # refused: the two values have different types; one type for both
        self.last = self.u if self.yes else Mode.ON
