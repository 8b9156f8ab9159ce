"""Chosen elements become an array."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ChosenElementsBecomeAnArray(Program):
    def begin(self) -> None:
        self.x3, self.y2 = np.zeros(3), np.zeros(2)
        self.i3, self.b3 = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.bool_)

    def control(self) -> None:
        # refused: the slice is assigned an array of another length; one number for all elements
        self.x3[self.b3] = np.zeros(3)
