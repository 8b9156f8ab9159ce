"""Property without a setter."""

from __future__ import annotations

from helpers.written_programs import Program


class PropertyWithoutASetter(Program):
    @property
    def twice(self):
        return 2.0 * self.u

    def control(self) -> None:
        # refused: the property twice has no setter; an attribute
        self.twice = 1.0
