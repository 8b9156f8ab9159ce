"""Bool then number."""

from __future__ import annotations

from helpers.written_programs import Program


class BoolThenNumber(Program):
    def control(self) -> None:
        k: float = True
        if self.u > 1.0:
            k = 2.0
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(k)
