"""Array of another length is assigned."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayOfAnotherLengthIsAssigned(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: it is assigned, and is not a number or a state; numbers, states, tuples of numbers
        self.x3 = self.y2
