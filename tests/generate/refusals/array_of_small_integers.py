"""Array of small integers."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayOfSmallIntegers(Program):
    def control(self) -> None:
        # refused: this type of number cannot be translated; float, np.float64, np.int64, np.bool_
        self.k = float(np.zeros(3, dtype=np.int8).sum())
