"""Arrays of two lengths."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArraysOfTwoLengths(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: the arrays have different lengths: 2 and 3 elements
        self.k = (self.x3 + self.y2).sum()
