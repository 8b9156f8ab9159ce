"""What may be None in a list."""

from __future__ import annotations

from helpers.written_programs import Program


class NoneInAList(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: a value that may be None stands in a list or an array; `if x is not None`
        self.row[0] = self.maybe  # type: ignore[call-overload]
