"""Object with its own equality and none."""

from __future__ import annotations

from helpers.written_programs import Program


class Own:
    def __eq__(self, other):
        return True

    def __hash__(self):
        return 0


class ObjectWithItsOwnEqualityAndNone(Program):
    def begin(self) -> None:
        self.own = Own()

    def control(self) -> None:
        # refused: the class of this object defines what is equal to it; is None
        self.yes = self.own == None  # noqa: E711
