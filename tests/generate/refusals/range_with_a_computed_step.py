"""Range with a computed step."""

from __future__ import annotations

from helpers.written_programs import Program


class RangeWithAComputedStep(Program):
    def control(self) -> None:
        # refused: the step of a range is not known
        for each in range(0, 10, self.n):
            self.c += each
