"""List is replaced."""

from __future__ import annotations

from helpers.written_programs import Program


class ListIsReplaced(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: a list is assigned as a whole; its elements, one by one: x[:] = ...
        self.row = [self.u, self.n]
