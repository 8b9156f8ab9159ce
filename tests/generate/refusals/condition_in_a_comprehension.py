"""A comprehension whose length is not known."""

from __future__ import annotations

from helpers.written_programs import Program


class ConditionInAComprehension(Program):
    def control(self) -> None:
        # refused: the comprehension has an `if`, so its length is not known; any, all, sum, min, max, len or next of it; a loop
        found = tuple(each for each in (self.u, 1.0) if each > 0.0)
        self.k = found[0]
