"""Function made at run time."""

from __future__ import annotations

from helpers.written_programs import Program

MADE = eval("lambda x: x + 1.0")


class FunctionMadeAtRunTime(Program):
    def control(self) -> None:
        # refused: <lambda>: its source is not there
        self.k = MADE(self.u)
