"""A default that is no number."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class DefaultOfAnotherType(Program):
    def control(self) -> None:
        # refused: the two values have different types; one type for both
        self.yes = max((each for each in (self.u, self.k) if each > 1.0), default=Mode.OFF) is Mode.ON  # type: ignore
