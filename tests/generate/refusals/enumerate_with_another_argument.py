"""enumerate with an argument by its name."""

from __future__ import annotations

from helpers.written_programs import Program


class EnumerateWithAnotherArgument(Program):
    def control(self) -> None:
        # refused: an argument is given by keyword to `enumerate`; a positional argument
        for i, each in enumerate(iterable=(self.u, 1.0)):
            self.k = each + i
