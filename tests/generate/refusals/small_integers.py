"""Small integers."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SmallIntegers(Program):
    def begin(self) -> None:
        self.row = np.zeros(3, np.int8)

    def control(self) -> None:
        # refused: a ndarray is not a number or a state on the controller; an Enum
        self.row = self.row + 100
        # refused: a int8 of numpy; np.float64, np.int64, float(...)
        self.k = float(self.row[0])
