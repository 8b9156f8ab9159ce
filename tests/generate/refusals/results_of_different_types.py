"""Results of different types."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class ResultsOfDifferentTypes(Program):
    def found(self):
        if self.yes:
            return Mode.ON
        # refused: the results have different types; one type
        return 1.0

    def control(self) -> None:
        self.found()
