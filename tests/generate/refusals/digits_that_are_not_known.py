"""Digits that are not known."""

from __future__ import annotations

from helpers.written_programs import Program


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


class DigitsThatAreNotKnown(Numbers):
    def control(self) -> None:
        # refused: `round` has an unknown number of digits, or a number outside 0 to 22; round(x, 2)
        self.k = round(self.u, self.n)
