"""Reals added to whole numbers in place."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class RealsAddedToWholeNumbersInPlace(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: the array is assigned numbers of another type; a new array
        self.i3 += self.x3
