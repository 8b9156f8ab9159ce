"""Array added to another length in place."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ChosenElementsBecomeTheirArray(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.x3[self.b3] = self.x3
