"""Number of numpy in a list."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NumberOfNumpyInAList(Program):
    def begin(self) -> None:
        self.row, self.array = [1.0, 2.0], np.ones(2)

    def control(self) -> None:
        # refused: a list cannot contain a number of numpy; float(...), int(...), bool(...)
        self.row[0] = self.array[0]
        self.k = float(self.row[0] / 0.0)
