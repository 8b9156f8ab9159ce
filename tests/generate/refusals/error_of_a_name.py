"""Error of a name."""

from __future__ import annotations

from helpers.written_programs import Program


class ErrorOfAName(Program):
    def control(self) -> None:
        # refused: a type is not a number or a state on the controller; an Enum
        error = ValueError if self.yes else KeyError
        raise error
