"""Place in a tuple that changes."""

from __future__ import annotations

from helpers.written_programs import Program


class PlaceInATupleThatChanges(Program):
    def next(self):
        self.k += 1.0
        return 1

    def control(self) -> None:
        # refused: the place changes what has the element; a name for the place first
        self.k = (self.u, self.k)[self.next()]
