"""An extreme of no elements, by a key."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeOfNoElements(Program):
    def control(self) -> None:
        # refused: a minimum or maximum of no elements; elements
        self.k = max((), key=abs)
