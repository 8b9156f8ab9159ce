"""Parameters of a dict."""

from __future__ import annotations

from helpers.written_programs import Program


class ParametersOfADict(Program):
    def scaled(self, **named):
        return 2.0

    def control(self) -> None:
        # refused: ** cannot be translated; name the arguments
        self.k = self.scaled(by=self.u)
