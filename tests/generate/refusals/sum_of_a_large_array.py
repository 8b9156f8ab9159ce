"""Sum of a large array."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SumOfALargeArray(Program):
    def begin(self) -> None:
        self.large = np.zeros(200)

    def control(self) -> None:
        # refused: the sum has 200 numbers; at most 128, or a loop
        self.k = self.large.sum()
