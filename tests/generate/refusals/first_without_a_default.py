"""`next` without a default."""

from __future__ import annotations

from helpers.written_programs import Program


class FirstWithoutADefault(Program):
    def control(self) -> None:
        # refused: `next` is applied to a generator that may be empty or has two loops; next(..., 0.0), a loop
        self.k = next(each for each in (self.u, self.k) if each > 1.0)
