"""Long shift."""

from __future__ import annotations

from helpers.written_programs import Program


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


class LongShift(Numbers):
    def control(self) -> None:
        # refused: a shift by 100000 cannot be translated; at most 64
        self.c = 1 << 100000
