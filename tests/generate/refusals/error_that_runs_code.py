"""Error that runs code."""

from __future__ import annotations

from helpers.written_programs import Program


class Loud(Exception):
    def __init__(self, number: int) -> None:
        super().__init__(1 / (number - 1))


class ErrorThatRunsCode(Program):
    def control(self) -> None:
        if self.u > 1.0:
            # refused: Loud runs code when it is created; a class without __init__
            raise Loud(1)
