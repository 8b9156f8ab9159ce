"""Digits of what may be whole."""

from __future__ import annotations

from helpers.written_programs import Program


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


class DigitsOfWhatMayBeWhole(Numbers):
    def control(self) -> None:
        # refused: the number may be an int or a float; 0.0 instead of 0, float(...)
        self.k = round(max(0, self.u), 1) * 1.0
