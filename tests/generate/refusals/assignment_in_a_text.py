"""Assignment in a text."""

from __future__ import annotations

from helpers.written_programs import Program


class AssignmentInAText(Program):
    def control(self) -> None:
        # refused: it is not proved that the text has no effect and cannot fail: it may change something or fail; assign it to a name first
        print(f"{(last := self.u)}")
        self.k = 1.0
