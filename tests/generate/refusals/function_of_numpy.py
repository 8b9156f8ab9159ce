"""Function of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class FunctionOfNumpy(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: np.sin cannot be translated; np.where, clip, maximum, minimum, abs, isfinite, zeros, full; a loop with functions of math
        self.x3 = np.sin(self.x3)
