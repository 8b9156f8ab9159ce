"""Format that fails."""

from __future__ import annotations

from helpers.written_programs import Program


class FormatThatFails(Program):
    def control(self) -> None:
        # refused: it is not proved that the text has no effect and cannot fail: the format '.2f' does not suit all possible values; assign it to a name first
        print(f"{self.maybe:.2f}")
