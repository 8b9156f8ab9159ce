"""Array of another length in a field."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayOfAnotherLengthInAField(Program):
    def begin(self) -> None:
        self.x3, self.y2 = np.zeros(3), np.zeros(2)
        self.i3, self.b3 = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.bool_)

    def control(self) -> None:
        # refused: the two values have different types; one type for both
        self.x3 = self.x3 if self.yes else self.y2
