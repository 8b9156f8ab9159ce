"""Number or object is returned."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberOrObjectIsReturned(Program):
    # refused: the function returns an object here and a number elsewhere; only one of the two
    def found(self):
        if self.yes:
            return self.fan
        return 1.0

    def control(self) -> None:
        self.found()
