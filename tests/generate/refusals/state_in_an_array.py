"""State in an array."""

from __future__ import annotations

from enum import Enum

import numpy as np

from helpers.written_programs import Program


class Mode(Enum):
    OFF = 1
    ON = 2


class StateInAnArray(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )
        self.mode = Mode.OFF

    def control(self) -> None:
        # refused: the operand is neither an array nor a number
        self.x3 = self.x3 + self.mode
