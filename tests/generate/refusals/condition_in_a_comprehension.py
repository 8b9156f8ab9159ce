"""A comprehension whose length is not known."""

from __future__ import annotations

from helpers.written_programs import Program


class ConditionInAComprehension(Program):
    def control(self) -> None:
        # refused: `if` in a comprehension, whose length is then not known; a loop
        self.k = max([each for each in (self.u, 1.0) if each > 0.0])
