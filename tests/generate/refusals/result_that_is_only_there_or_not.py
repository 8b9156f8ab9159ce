"""Result that is only there or not."""

from __future__ import annotations

from helpers.written_programs import Program


class ResultThatIsOnlyThereOrNot(Program):
    def found(self):
        # refused: only whether it is None is known on the controller; is None, is not None
        return self.fan.inhibited

    def control(self) -> None:
        self.yes = self.found() is not None
