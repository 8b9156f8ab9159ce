"""Unknown attribute of a vector."""

from __future__ import annotations

from helpers.written_programs import Program
from umo import Vector


class UnknownAttributeOfAVector(Program):
    def begin(self) -> None:
        self.both = Vector([self.a, self.b])

    def control(self) -> None:
        # refused: `time` of a Vector cannot be translated; read, write, quality, pending, all_good
        self.k = self.both.time.sum()
