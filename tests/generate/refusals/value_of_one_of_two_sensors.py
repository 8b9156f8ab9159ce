"""Value of one of two sensors."""

from __future__ import annotations

from helpers.written_programs import Program
from umo.control import value_of


class ValueOfOneOfTwoSensors(Program):
    def begin(self) -> None:
        self.other = self.a

    def control(self) -> None:
        # refused: a DigitalSensor is not a number or a state on the controller; an Enum
        self.k = value_of(self.x if self.yes else self.other)
