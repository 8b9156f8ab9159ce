"""Result that is a bool or a number."""

from __future__ import annotations

from helpers.written_programs import Program


class ResultThatIsABoolOrANumber(Program):
    def given(self) -> float:
        if self.u > 1.0:
            return 2.0
        return True

    def control(self) -> None:
        # refused: it may be a bool, which no digital object accepts; float(...), int(...)
        self.a.write(self.given())
