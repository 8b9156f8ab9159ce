"""An IntEnum that decides what a sum is."""

from __future__ import annotations

from enum import IntEnum

from helpers.written_programs import Program


class Level(IntEnum):
    NONE = 0
    SOME = 1

    def __radd__(self, other: int) -> int:
        return other - int(self)


class MemberWithItsOwnSum(Program):
    def begin(self) -> None:
        self.level = Level.NONE

    def control(self) -> None:
        self.level = Level.SOME if self.u > 1.0 else Level.NONE
        # refused: the value is not a number
        self.c = 3 + self.level
