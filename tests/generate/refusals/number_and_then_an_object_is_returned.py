"""Number and then an object is returned."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberAndThenAnObjectIsReturned(Program):
    # refused: the function returns an object here and a number elsewhere; only one of the two
    def found(self):
        if self.u > 1.0:
            return self.u
        # refused: the function returns an object here and a number elsewhere; only one of the two
        return self.fan

    def control(self) -> None:
        self.k = self.found()
