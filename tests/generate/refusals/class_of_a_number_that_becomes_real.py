"""Class of a number that becomes real."""

from __future__ import annotations

from helpers.written_programs import Program


class ClassOfANumberThatBecomesReal(Program):
    def begin(self) -> None:
        self.v = 0

    def control(self) -> None:
        # refused: the value may be of another class; one name per class
        self.k = 1.0 if isinstance(self.v, float) else 2.0
        self.v = self.v + 0.5  # type: ignore[assignment]
