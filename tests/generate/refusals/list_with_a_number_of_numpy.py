"""A list of numbers, one of which is of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ListWithANumberOfNumpy(Program):
    def begin(self) -> None:
        self.row = [1.0, np.float64(2.0)]

    def control(self) -> None:
        # refused: row has values of several classes; one class for all elements
        self.k = float(self.row[self.n % 2])
