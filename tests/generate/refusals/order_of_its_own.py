"""Order of its own."""

from __future__ import annotations

from enum import IntEnum

from helpers.written_programs import Program


class Falling(IntEnum):
    ONE = 1
    TWO = 2

    def __lt__(self, other: int) -> bool:
        return int(self) > int(other)


class OrderOfItsOwn(Program):
    def begin(self) -> None:
        self.falling = Falling.ONE

    def control(self) -> None:
        self.falling = Falling.TWO if self.u > 1.0 else Falling.ONE
        # refused: a state is compared with something other than a state, or by order; `is`, with a state of the same Enum
        self.yes = self.falling < Falling.TWO
