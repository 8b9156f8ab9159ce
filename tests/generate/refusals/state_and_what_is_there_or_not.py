"""State and what is there or not."""

from __future__ import annotations

from enum import Enum

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class StateAndWhatIsThereOrNot(Program):
    def control(self) -> None:
        # refused: a state is compared with something other than a state; a state of the same Enum
        self.yes = Mode.ON is self.fan.inhibited
