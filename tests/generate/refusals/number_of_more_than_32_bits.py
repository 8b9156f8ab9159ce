"""Number of more than 32 bits."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberOfMoreThan32Bits(Program):
    def control(self) -> None:
        # refused: 10000000000 does not fit 32 bits; a smaller number, or a float
        self.c = self.n + 10_000_000_000
