"""Number is called."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberIsCalled(Program):
    def control(self) -> None:
        # refused: the called function is not known when the code is generated
        self.k = (self.u)()
