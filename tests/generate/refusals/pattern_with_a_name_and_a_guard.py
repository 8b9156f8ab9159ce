"""A name in a part of a pattern, and a guard."""

from __future__ import annotations

from helpers.written_programs import Program


class PatternWithANameAndAGuard(Program):
    def control(self) -> None:
        match self.n:
            # refused: a name in a pattern with an `if`; an `if` in the case
            case 1 | 2 as n if self.u > n:
                self.k = 1.0
