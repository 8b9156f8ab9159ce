"""Number or state."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class NumberOrState(Program):
    def control(self) -> None:
        # refused: the two values have different types; bool(...), one type for both
        self.k = (self.u or Mode.ON) and 1.0
