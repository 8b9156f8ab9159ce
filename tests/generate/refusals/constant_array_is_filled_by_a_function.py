"""Constant array is filled by a function."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program

CONSTANT = np.zeros(3)


class ConstantArrayIsFilledByAFunction(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: an array that is known when the code is generated is changed; a new array
        np.add(self.x3, 1.0, out=CONSTANT)
