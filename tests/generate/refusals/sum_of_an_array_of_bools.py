"""Sum of an array of bools."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SumOfAnArrayOfBools(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: the sum of an array of bools cannot be translated; np.sum, np.count_nonzero
        self.c = sum(self.b3)
