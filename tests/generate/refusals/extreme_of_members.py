"""The larger one of two members of an IntEnum, which is a member."""

from __future__ import annotations

from enum import IntEnum

from helpers.written_programs import Program


class Level(IntEnum):
    NONE = 0
    SOME = 1


class ExtremeOfMembers(Program):
    def begin(self) -> None:
        self.level, self.other = Level.NONE, Level.SOME

    def control(self) -> None:
        self.level = Level.SOME if self.u > 1.0 else Level.NONE
        self.other = Level.NONE if self.u > 2.0 else Level.SOME
        # refused: the value is not a number
        self.c = max(self.level, self.n) * 1
