"""Number or none and a tuple."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberOrNoneAndATuple(Program):
    def control(self) -> None:
        # refused: values of different classes are compared; `is None`
        self.yes = self.maybe == (1.0, 2.0)
