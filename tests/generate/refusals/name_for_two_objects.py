"""Name for two objects."""

from __future__ import annotations

from helpers.written_programs import Program


class NameForTwoObjects(Program):
    def control(self) -> None:
        which = self.a
        if self.yes:
            which = self.b
        # refused: it is used before it has a value on every way; give it a value first
        which.write(1.0)
