"""Truth of a state."""

from __future__ import annotations

from helpers.written_programs import Program
from umo.states import OnOff


class TruthOfAState(Program):
    def begin(self) -> None:
        self.state = OnOff.ON

    def control(self) -> None:
        self.state = OnOff.ON if self.u > 1.0 else OnOff.OFF
        # refused: OnOff defines its own truth value; `is`, with a state
        self.c = 1 if self.state else 2
