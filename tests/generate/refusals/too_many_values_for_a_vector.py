"""Too many values for a vector."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program
from umo import Vector


class TooManyValuesForAVector(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )
        self.both = Vector([self.a, self.b])

    def control(self) -> None:
        # refused: 3 values for 2 objects
        self.both.write(self.x3)
