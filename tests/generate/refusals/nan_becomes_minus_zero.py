"""A NaN that becomes -0.0."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NanBecomesMinusZero(Program):
    def begin(self) -> None:
        self.x3 = np.zeros(3)

    def control(self) -> None:
        # refused: np.nan_to_num cannot be translated; np.where, clip, maximum, minimum, abs, isfinite, zeros, full; a loop with functions of math
        self.x3 = np.nan_to_num(np.full(3, self.u), nan=-0.0)
