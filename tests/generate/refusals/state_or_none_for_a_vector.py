"""State or none for a vector."""

from __future__ import annotations

from helpers.written_programs import Program
from umo import Vector
from umo.states import OnOff


class StateOrNoneForAVector(Program):
    def begin(self) -> None:
        self.state: OnOff | None = OnOff.ON
        self.both = Vector([self.fan])

    def control(self) -> None:
        # refused: a state that may be None is written to a Vector; check it first
        self.both.write(self.state)
        self.state = None
