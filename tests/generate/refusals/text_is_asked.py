"""Text is asked."""

from __future__ import annotations

from helpers.written_programs import Program


class TextIsAsked(Program):
    def control(self) -> None:
        said = f"{self.u}"
        # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
        if said:
            self.k = 1.0
