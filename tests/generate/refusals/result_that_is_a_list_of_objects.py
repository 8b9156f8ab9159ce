"""Result that is a list of objects."""

from __future__ import annotations

from helpers.written_programs import Program


class ResultThatIsAListOfObjects(Program):
    def found(self):
        # refused: the result is not a number, a state or a tuple of these
        return [self.u, (self.fan, self.a)]

    def control(self) -> None:
        self.found()
