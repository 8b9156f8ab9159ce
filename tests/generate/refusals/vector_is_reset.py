"""Vector is reset."""

from __future__ import annotations

from helpers.written_programs import Program
from umo import Vector


class VectorIsReset(Program):
    def begin(self) -> None:
        self.both = Vector([self.a, self.b])

    def control(self) -> None:
        # refused: `reset` of a Vector cannot be translated; read, write, quality, pending, all_good
        self.both.reset()
