"""reversed of what has no end to begin from."""

from __future__ import annotations

from helpers.written_programs import Program


class IteratorThatIsReversed(Program):
    def control(self) -> None:
        # refused: `reversed` is applied to something that is not a list, a tuple or a range; a list, a tuple, range
        for i, each in reversed(enumerate((self.u, 1.0))):
            self.k = each + i
