"""Number and then an object is returned."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberAndThenAnObjectIsReturned(Program):
    # refused: an object is returned, and elsewhere a number; one of both
    def found(self):
        if self.u > 1.0:
            return self.u
        # refused: an object is returned, and elsewhere a number; one of both
        return self.fan

    def control(self) -> None:
        self.k = self.found()
