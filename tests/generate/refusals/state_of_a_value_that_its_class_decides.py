"""An Enum defines the member for a value itself."""

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
        # refused: Mode defines the member for a value itself; a dict of its members
        self.mode = Mode(self.n)
