"""Bool in a tuple."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Numbers(NamedTuple):
    first: int
    second: int


class BoolInATuple(Program):
    def begin(self) -> None:
        self.two = Numbers(0, 1)

    def control(self) -> None:
        # refused: a bool takes the place of an int in the tuple; int(...)
        self.two = Numbers(self.u > 2.0, 1)
        self.a.write(self.two[0])
