"""Negative whole number of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NegativeWholeNumberOfNumpy(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: - of a numpy integer cannot be translated; int(...), or 0 - x
        self.c = int(-self.i3[0])
