"""Too many arguments."""

from __future__ import annotations

from helpers.written_programs import Program


class TooManyArguments(Program):
    def scaled(self, by):
        return by * 2.0

    def control(self) -> None:
        # refused: too many positional arguments
        self.k = self.scaled(self.u, 1.0)
