"""Sum with a state."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class SumWithAState(Program):
    def begin(self) -> None:
        self.mode = Mode.OFF

    def control(self) -> None:
        # refused: the value is not a number
        self.k = self.u + self.mode
