"""States of two enums of numbers."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class One(int, Enum):
    A = 1


class Two(int, Enum):
    A = 1


class StatesOfTwoEnumsOfNumbers(Program):
    def begin(self) -> None:
        self.one, self.two = One.A, Two.A
        self.t = 0

    def control(self) -> None:
        # refused: the states belong to different Enums that are numbers or texts; `is`, .value
        self.yes = self.one == self.two
