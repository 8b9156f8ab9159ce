"""State and number."""

from __future__ import annotations

from helpers.written_programs import Program
from umo.states import OnOff


class StateAndNumber(Program):
    def begin(self) -> None:
        self.state = OnOff.ON

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        # refused: the value is compared with another type, for which Python raises TypeError; its states
        self.c = int(self.state != 1)
