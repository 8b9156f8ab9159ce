"""Name of a member."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"

    @property
    def sign(self) -> float:
        return -1.0 if self is Side.LEFT else 1.0

    def turned(self, yes: bool = True) -> Side:
        return (Side.LEFT if self is Side.RIGHT else Side.RIGHT) if yes else self


class NameOfAMember(Program):
    def begin(self) -> None:
        self.side = Side.LEFT

    def control(self) -> None:
        self.side = Side.RIGHT if self.u > 1.0 else Side.LEFT
        # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
        self.yes = self.side.name == "LEFT"
