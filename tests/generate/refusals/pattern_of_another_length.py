"""Pattern of another number of elements."""

from __future__ import annotations

from helpers.written_programs import Program


class PatternOfAnotherLength(Program):
    def control(self) -> None:
        match self.u, self.n:
            # refused: the pattern has another number of elements; one pattern per element
            case (_,):  # type: ignore[misc]
                self.k = 1.0
