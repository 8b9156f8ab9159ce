"""State and state of another type."""

from __future__ import annotations

from helpers.written_programs import Program
from umo.states import OnOff, PassFail


class StateAndStateOfAnotherType(Program):
    def begin(self) -> None:
        self.state, self.other = OnOff.ON, PassFail.PASS

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        self.other = PassFail.PASS if self.u > 2.0 else PassFail.FAIL
        # refused: the value is compared with another type, for which Python raises TypeError; its states
        self.c = int(self.state == self.other)
