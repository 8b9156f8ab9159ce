"""Real in a list of whole numbers."""

from __future__ import annotations

from helpers.written_programs import Program


class RealInAListOfWholeNumbers(Program):
    def begin(self) -> None:
        self.row = [1, 2, 3]

    def control(self) -> None:
        # refused: a real number where a whole number was before; int(...), or a real number from the start
        self.row[1] = self.u  # type: ignore[call-overload]
        self.a.write(self.row[1])
