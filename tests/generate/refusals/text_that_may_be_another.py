"""Text that may be another."""

from __future__ import annotations

from helpers.written_programs import Program


class TextThatMayBeAnother(Program):
    def begin(self) -> None:
        self.note = ""

    def control(self) -> None:
        # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
        self.a.write(1.0 if isinstance(self.note, str) and self.note in ("seen",) else 2.0)
        self.note = f"seen {self.n}"
