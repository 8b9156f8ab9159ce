"""Several hundred numbers in one expression."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SeveralHundredNumbersInOneExpression(Program):
    def begin(self) -> None:
        self.large = np.zeros(300)

    def control(self) -> None:
        # refused: the expression has 300 numbers; at most 256, or a loop
        self.k = max(self.large)
