"""Argument that is only there or not."""

from __future__ import annotations

from helpers.written_programs import Program


class ArgumentThatIsOnlyThereOrNot(Program):
    def given(self, one):
        return one is None

    def control(self) -> None:
        # refused: the argument 'one' is not a value that a controller can hold
        self.yes = self.given(self.fan.inhibited)
