"""Function made at run time."""

from __future__ import annotations

from helpers.written_programs import Program

MADE = eval("lambda x: x + 1.0")


class FunctionMadeAtRunTime(Program):
    def control(self) -> None:
        # refused: <lambda>: it is not written in Python, or was created at run time; `def` in a file of the station
        self.k = MADE(self.u)
