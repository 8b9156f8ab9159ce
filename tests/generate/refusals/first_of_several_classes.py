"""The first one of numbers and states."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class FirstOfSeveralClasses(Program):
    def begin(self) -> None:
        self.mode = Mode.OFF

    def control(self) -> None:
        # refused: 'each' has values of different types; one type for each name
        self.yes = next((each for each in (self.u, self.mode) if self.n > 1), None) is None
