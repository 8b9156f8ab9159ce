"""Number or object is returned."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberOrObjectIsReturned(Program):
    # refused: an object is returned, and elsewhere a number; one of both
    def found(self):
        if self.yes:
            return self.fan
        return 1.0

    def control(self) -> None:
        self.found()
