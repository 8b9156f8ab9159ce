"""A bool or a state under a name."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class TruthThatIsKept(Program):
    mode: Mode | None

    def begin(self) -> None:
        self.mode = None

    def control(self) -> None:
        self.mode = Mode.ON if self.u > 1.0 else None
        # refused: the two values have different types; bool(...), one type for both
        found = self.yes and self.mode
        self.c = 1 if found else 2
