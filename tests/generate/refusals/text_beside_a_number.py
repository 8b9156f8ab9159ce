"""A text that is compared with a number."""

from __future__ import annotations

from helpers.written_programs import Program


class TextBesideANumber(Program):
    def begin(self) -> None:
        self.phase = "idle"

    def control(self) -> None:
        self.phase = "hold" if self.u > 1.0 else "idle"
        # refused: a string is compared with something other than a string, or by order; ==, with a string
        self.yes = self.phase == self.n
