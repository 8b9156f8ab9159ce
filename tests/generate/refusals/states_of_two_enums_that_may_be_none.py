"""States of two enums that may be none."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class One(Enum):
    A = 1


class Two(Enum):
    A = 1


class StatesOfTwoEnumsThatMayBeNone(Program):
    def begin(self) -> None:
        self.one: One | None = One.A
        self.two: Two | None = Two.A

    def control(self) -> None:
        # refused: the states belong to different Enums, and both may be None; `is`, .value
        self.yes = self.one == self.two
        self.one, self.two = None, None
