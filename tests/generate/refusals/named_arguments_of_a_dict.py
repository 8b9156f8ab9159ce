"""Named arguments of a dict."""

from __future__ import annotations

from helpers.written_programs import Program

GIVEN = {"by": 2.0}


class NamedArgumentsOfADict(Program):
    def scaled(self, by):
        return by * 2.0

    def control(self) -> None:
        # refused: ** cannot be translated; name the arguments
        self.k = self.scaled(**GIVEN)
