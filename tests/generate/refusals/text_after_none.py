"""Text after none."""

from __future__ import annotations

from helpers.written_programs import Program


class TextAfterNone(Program):
    def begin(self) -> None:
        self.note: str | None = None

    def control(self) -> None:
        # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
        self.a.write(1.0 if self.note is None else 2.0)
        self.note = "x"
