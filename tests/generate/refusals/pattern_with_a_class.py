"""Pattern with a class."""

from __future__ import annotations

from helpers.written_programs import Program


class PatternWithAClass(Program):
    def control(self) -> None:
        match self.u:
            # refused: this pattern does not translate; values, None, |, _, names and `if`; (a, b) of a tuple that is written down
            case float():
                self.k = 1.0
            case _:
                self.k = 2.0
