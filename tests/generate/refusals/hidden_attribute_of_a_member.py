"""An attribute of a member that is not made for others."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Side(Enum):
    LEFT = 1
    RIGHT = 2


class HiddenAttributeOfAMember(Program):
    def begin(self) -> None:
        self.side = Side.LEFT

    def control(self) -> None:
        self.side = Side.RIGHT if self.u > 1.0 else Side.LEFT
        # refused: the attribute '_value_' of a state cannot be translated; value, a method, a property
        self.c = self.side._value_
