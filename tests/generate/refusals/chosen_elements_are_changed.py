"""Chosen elements are changed."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ChosenElementsAreChanged(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: elements selected by a mask are changed by a call, by an array, or are not floats; assign the number to a name first, np.where
        self.x3[self.x3 > 1.0] += self.x3
