"""An Enum decides which member a value stands for."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2

    @classmethod
    def _missing_(cls, value: object) -> Mode:
        return cls.OFF


class StateOfAValueThatItsClassDecides(Program):
    def begin(self) -> None:
        self.mode = Mode.ON

    def control(self) -> None:
        # refused: Mode decides which member a value stands for; a dict of its members
        self.mode = Mode(self.n)
