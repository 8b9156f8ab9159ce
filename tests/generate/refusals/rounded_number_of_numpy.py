"""Rounded number of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class RoundedNumberOfNumpy(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: numpy rounds to a number of digits differently; round(float(x), 2)
        self.k = round(self.x3[0], 2)
