"""Power that is not known."""

from __future__ import annotations

from helpers.written_programs import Program


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


class PowerThatIsNotKnown(Numbers):
    def control(self) -> None:
        # refused: this arithmetic of whole numbers cannot be translated; +, -, *, //, %, /, ** with a known exponent
        self.c = self.n**self.i
