"""Error that is kept."""

from __future__ import annotations

from helpers.written_programs import Program


class ErrorThatIsKept(Program):
    def begin(self) -> None:
        self.error = ValueError("x")

    def control(self) -> None:
        # refused: the class of the error is not known when the code is generated; raise Error(...)
        raise self.error
