"""None either way."""

from __future__ import annotations

from helpers.written_programs import Program


class NoneEitherWay(Program):
    def begin(self) -> None:
        self.last: float | None = None

    def control(self) -> None:
        # refused: it is None in both cases
        self.last = None if self.yes else None
