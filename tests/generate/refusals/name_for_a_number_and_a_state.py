"""Name for a number and a state."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class NameForANumberAndAState(Program):
    def control(self) -> None:
        which = self.u
        # refused: 'which' has values of different types; one type for each name
        which = Mode.ON
        self.yes = which is Mode.ON
