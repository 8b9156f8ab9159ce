"""Number of elements."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NumberOfElements(Program):
    def begin(self) -> None:
        self.array = np.ones(2)

    def control(self) -> None:
        # refused: numpy and Python differ here if the divisor is 0; float(...)
        self.c = int(np.count_nonzero(self.array) // (self.c * 0))
