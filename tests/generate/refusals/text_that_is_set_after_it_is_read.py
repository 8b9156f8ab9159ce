"""Text that is set after it is read."""

from __future__ import annotations

from helpers.written_programs import Program


class TextThatIsSetAfterItIsRead(Program):
    def begin(self) -> None:
        self.note = ""

    def marks(self) -> None:
        self.note = f"seen {self.n}"

    def control(self) -> None:
        # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
        self.a.write(1.0 if self.note == "" else 2.0)
        self.marks()
