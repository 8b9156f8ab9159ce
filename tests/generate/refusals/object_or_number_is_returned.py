"""Object or number is returned."""

from __future__ import annotations

from helpers.written_programs import Program


class ObjectOrNumberIsReturned(Program):
    # refused: the function returns an object here and a number elsewhere; only one of the two
    def found(self):
        if self.yes:
            return 1.0
        return self.fan

    def control(self) -> None:
        self.found()
