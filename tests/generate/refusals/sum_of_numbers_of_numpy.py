"""Sum of numbers of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SumOfNumbersOfNumpy(Program):
    def begin(self) -> None:
        self.array = np.ones(2)

    def control(self) -> None:
        # refused: numpy and Python differ here if the divisor is 0; float(...)
        self.k = float(sum(self.array) // 0.0)
