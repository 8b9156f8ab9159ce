"""One or true."""

from __future__ import annotations

from helpers.written_programs import Program


class OneOrTrue(Program):
    def control(self) -> None:
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(1 if self.u > 1.0 else True)
