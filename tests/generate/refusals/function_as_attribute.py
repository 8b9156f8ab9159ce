"""Function as attribute."""

from __future__ import annotations

from helpers.written_programs import Program


class FunctionAsAttribute(Program):
    def begin(self) -> None:
        self.curve = lambda number: number * 2.0

    def control(self) -> None:
        # refused: curve is a function stored as an attribute of an object; a method
        self.k = self.curve(self.u)
