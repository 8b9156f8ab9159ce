"""Name for two objects."""

from __future__ import annotations

from helpers.written_programs import Program


class NameForTwoObjects(Program):
    def control(self) -> None:
        which = self.a
        if self.yes:
            which = self.b
        # refused: on some branches it has no value or another object; give it a value first, or use one name per object
        which.write(1.0)
