"""Reals cast to whole numbers."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class RealsCastToWholeNumbers(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: floats of an array are converted to integers; a loop with int()
        self.i3 = self.x3.astype(np.int64)
