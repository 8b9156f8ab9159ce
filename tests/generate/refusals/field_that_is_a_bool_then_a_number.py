"""Field that is a bool then a number."""

from __future__ import annotations

from helpers.written_programs import Program


class FieldThatIsABoolThenANumber(Program):
    def control(self) -> None:
        self.c = self.u > 1.0
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(self.c)
