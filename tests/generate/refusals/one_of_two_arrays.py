"""A name for one of two arrays, one of which is changed in place."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class OneOfTwoArrays(Program):
    def begin(self) -> None:
        self.row, self.other = np.zeros(3), np.ones(3)

    def control(self) -> None:
        row = self.row if self.u > 1.0 else self.other
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.row[1] += 1.0
        self.k = float(row[1])
