"""Format that fails."""

from __future__ import annotations

from helpers.written_programs import Program


class FormatThatFails(Program):
    def control(self) -> None:
        # refused: a text that a controller does not have, and that may fail; a name for it first
        print(f"{self.maybe:.2f}")
