"""enumerate from a number that is computed."""

from __future__ import annotations

from helpers.written_programs import Program


class EnumerateFromAComputedNumber(Program):
    def control(self) -> None:
        # refused: `enumerate` starts from an unknown number; i + start
        for i, each in enumerate((self.u, 1.0), self.n):
            self.k = each + i
