"""Arrays of two classes, one after the other."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArraysOfTwoClassesJoined(Program):
    def begin(self) -> None:
        self.row, self.mask = np.array([0.5, 1.5]), np.array([True, False])

    def control(self) -> None:
        # refused: arrays with different types of numbers are joined; arrays of one class
        self.k = float(np.concatenate((self.row, self.mask)).sum())
