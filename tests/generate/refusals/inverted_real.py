"""Inverted real."""

from __future__ import annotations

from helpers.written_programs import Program


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


class InvertedReal(Numbers):
    def control(self) -> None:
        # refused: a bit operator is applied to something other than integers; int(...)
        self.c = ~self.u  # type: ignore[operator]
