"""Value of what is computed."""

from __future__ import annotations

from helpers.written_programs import Program
from umo.control import value_of


class ValueOfWhatIsComputed(Program):
    def control(self) -> None:
        # refused: the sensor is not known when the code is generated
        self.k = value_of(self.u)
