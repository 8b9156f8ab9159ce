"""Message that fails."""

from __future__ import annotations

from helpers.written_programs import Program


class MessageThatFails(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        if self.u > 1.0:
            # refused: it is not proved that the text has no effect and cannot fail: it may not have this element; assign it to a name first
            raise ValueError(f"{self.row[self.n]}")
