"""Place that changes the values."""

from __future__ import annotations

from helpers.written_programs import Program


class PlaceThatChangesTheValues(Program):
    """Python has the values before it computes the place."""

    def changes(self) -> int:
        self.k = 7.0
        return self.n % 2

    def control(self) -> None:
        # refused: the place changes what has the element; a name for the place first
        self.a.write((self.k, self.u, 0.0)[self.changes()])
