"""State with its own equal."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Odd(Enum):
    """Its members are equal to each other."""

    ONE = 1
    TWO = 2

    def __eq__(self, other: object) -> bool:
        return True

    def __hash__(self) -> int:
        return 0

    def __bool__(self) -> bool:
        return self is Odd.TWO


class StateWithItsOwnEqual(Program):
    def begin(self) -> None:
        self.odd = Odd.ONE

    def control(self) -> None:
        # refused: <Odd.TWO: 2> is not a number or a state on the controller; an Enum
        self.odd = Odd.TWO if self.u > 1.0 else Odd.ONE
        # refused: the class of these objects defines which are equal; `is`
        self.c = int(self.odd == Odd.ONE)
