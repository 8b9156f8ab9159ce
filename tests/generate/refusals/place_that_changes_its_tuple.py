"""Place that changes its tuple."""

from __future__ import annotations

from helpers.written_programs import Program


class PlaceThatChangesItsTuple(Program):
    def begin(self) -> None:
        self.pair = (1.0, 2.0)

    def next(self):
        self.pair = (3.0, 4.0)
        return 1

    def control(self) -> None:
        # refused: the place changes what has the element; a name for the place first
        self.k = self.pair[self.next()]
