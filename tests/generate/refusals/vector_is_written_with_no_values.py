"""Vector is written with no values."""

from __future__ import annotations

from helpers.written_programs import Program
from umo import Vector


class VectorIsWrittenWithNoValues(Program):
    def begin(self) -> None:
        self.both = Vector([self.a, self.b])

    def control(self) -> None:
        # refused: `write` of a Vector cannot be translated; read, write, quality, pending, all_good
        self.both.write()
