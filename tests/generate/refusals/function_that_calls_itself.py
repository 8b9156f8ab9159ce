"""Function that calls itself."""

from __future__ import annotations

from helpers.written_programs import Program


class FunctionThatCallsItself(Program):
    def down(self, n):
        # refused: the function calls itself; a loop
        return 0.0 if n < 1 else self.down(n - 1)

    def control(self) -> None:
        self.k = self.down(self.n)
