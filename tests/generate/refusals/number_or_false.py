"""Number or false."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberOrFalse(Program):
    def control(self) -> None:
        # refused: it may be a bool, which is written to no number; float(...), int(...)
        self.a.write(self.u or False)
