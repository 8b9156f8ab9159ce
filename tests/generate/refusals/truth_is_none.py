"""A bool or a state that is compared with None."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class TruthIsNone(Program):
    mode: Mode | None

    def begin(self) -> None:
        self.mode = None

    def control(self) -> None:
        self.mode = Mode.ON if self.u > 1.0 else None
        # refused: the two values have different types; bool(...), one type for both
        self.yes = (self.n > 1 and self.mode) is None
