"""An extreme of no elements, by a key."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeOfNoElements(Program):
    def control(self) -> None:
        # refused: the minimum or maximum has no elements; elements
        self.k = max((), key=abs)
