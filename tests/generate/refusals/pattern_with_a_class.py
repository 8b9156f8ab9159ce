"""Pattern with a class."""

from __future__ import annotations

from helpers.written_programs import Program


class PatternWithAClass(Program):
    def control(self) -> None:
        match self.u:
            # refused: this pattern does not translate; values, None, |, _ and `if`
            case float():
                self.k = 1.0
            case _:
                self.k = 2.0
