"""Object or number."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class Helper:
    def __init__(self) -> None:
        self.k = 0.0


class ObjectOrNumber(Program):
    def begin(self) -> None:
        self.helper = Helper()

    # refused: the function returns an object here and a number elsewhere; only one of the two
    def found(self) -> Any:
        if self.u > 1.0:
            return self.helper
        return 1.0

    def control(self) -> None:
        self.yes = self.found() == 1.0
