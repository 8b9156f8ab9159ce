"""Time of the computer."""

from __future__ import annotations

from helpers.written_programs import Program


class TimeOfTheComputer(Program):
    def begin(self) -> None:
        self.part = self.x._parent

    def control(self) -> None:
        # refused: `utc` of the cycle is not known on a controller; dt, now, cycle.period
        self.k = self.part.cycle.utc
