"""Range of reals."""

from __future__ import annotations

from helpers.written_programs import Program


class RangeOfReals(Program):
    def control(self) -> None:
        # refused: a real number where a whole number was before; int(...), or a real number from the start
        for _ in range(self.u):  # type: ignore[call-overload]
            self.c += 1
