"""Range over a computed number."""

from __future__ import annotations

from helpers.written_programs import Program


class RangeOverAComputedNumber(Program):
    def control(self) -> None:
        # refused: range is applied to something that is not known when the code is generated
        self.c = len(list(range(self.n)))
