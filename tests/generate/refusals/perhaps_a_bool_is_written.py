"""Perhaps a bool is written."""

from __future__ import annotations

from helpers.written_programs import Program


class Numbers(Program):
    """`u` and `v` are floats, `n` and `i` whole numbers."""

    def begin(self) -> None:
        self.v, self.i, self.flag, self.r, self.s, self.on = 0.0, 0, False, 0.0, 0.0, False


class PerhapsABoolIsWritten(Numbers):
    def control(self) -> None:
        one = self.n > 3 if self.i > 0 else self.n
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(one & (self.n > 2))
