"""Large power."""

from __future__ import annotations

from helpers.written_programs import Program


class LargePower(Program):
    def control(self) -> None:
        # refused: a power of 100 cannot be translated; the number itself
        self.k = 2**100
