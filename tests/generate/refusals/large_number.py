"""Large number."""

from __future__ import annotations

from helpers.written_programs import Program


class LargeNumber(Program):
    def begin(self) -> None:
        self.large = 10**12

    def control(self) -> None:
        # refused: large is 1000000000000, and does not fit 32 bits; a smaller number, or a float
        self.k = self.large * 1.0
