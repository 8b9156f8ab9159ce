"""Complex number."""

from __future__ import annotations

from helpers.written_programs import Program


class ComplexNumber(Program):
    def control(self) -> None:
        # refused: a complex cannot be translated; numbers, states, bools, None
        self.k = abs(1j * self.u)
