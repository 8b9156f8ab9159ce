"""Print that changes something."""

from __future__ import annotations

from helpers.written_programs import Program


class PrintThatChangesSomething(Program):
    def bump(self) -> float:
        self.k += 1.0
        return self.k

    def control(self) -> None:
        # refused: a call in a text that a controller does not have; a name for it first
        print(self.bump())
