"""Number or false."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberOrFalse(Program):
    def control(self) -> None:
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(self.u or False)
