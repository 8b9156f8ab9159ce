"""Generator over a list that a call changes."""

from __future__ import annotations

from helpers.written_programs import Program


class GeneratorOverAListThatACallChanges(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def next(self):
        self.row[1] = self.u
        return self.u

    def control(self) -> None:
        # refused: a call may change the elements of the generator; a loop
        self.yes = any(self.next() > each for each in self.row)
