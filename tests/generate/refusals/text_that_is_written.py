"""A text that is written to a binary actuator."""

from __future__ import annotations

from helpers.written_programs import Program


class TextThatIsWritten(Program):
    def begin(self) -> None:
        self.phase = "OFF"

    def control(self) -> None:
        self.phase = "ON" if self.u > 1.0 else "OFF"
        # refused: a text is written; a state of the object
        self.fan.write(self.phase)
