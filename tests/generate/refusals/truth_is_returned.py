"""A bool or a state is returned."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class TruthIsReturned(Program):
    mode: Mode | None

    def begin(self) -> None:
        self.mode = None

    def found(self) -> object:
        # refused: the two values have different types; bool(...), one type for both
        return self.n > 1 and self.mode

    def control(self) -> None:
        self.mode = Mode.ON if self.u > 1.0 else None
        self.yes = bool(self.found())
