"""Number of numpy in a tuple."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from helpers.written_programs import Program


class Pair(NamedTuple):
    first: float
    second: float


class NumberOfNumpyInATuple(Program):
    def begin(self) -> None:
        self.array = np.ones(2)

    def control(self) -> None:
        # refused: a tuple cannot contain a number of numpy; float(...), int(...), bool(...)
        pair = Pair(self.array[0], self.u)
        self.k = float(pair.first / 0.0)
