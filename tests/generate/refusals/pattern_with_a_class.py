"""Pattern with a class."""

from __future__ import annotations

from helpers.written_programs import Program


class PatternWithAClass(Program):
    def control(self) -> None:
        match self.u:
            # refused: this pattern cannot be translated; values, None, |, _, names and `if`; (a, b) for a tuple that is written out
            case float():
                self.k = 1.0
            case _:
                self.k = 2.0
