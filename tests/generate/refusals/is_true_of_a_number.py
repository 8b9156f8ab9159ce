"""Is true of a number."""

from __future__ import annotations

from helpers.written_programs import Program


class IsTrueOfANumber(Program):
    def control(self) -> None:
        # refused: numbers are compared by `is`; ==
        self.yes = self.n is True
