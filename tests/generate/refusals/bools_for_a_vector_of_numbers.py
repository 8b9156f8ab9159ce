"""Bools for a vector of numbers."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program
from umo import Vector


class BoolsForAVectorOfNumbers(Program):
    def begin(self) -> None:
        self.b2 = np.zeros(2, dtype=np.bool_)
        self.both = Vector([self.a, self.b])

    def control(self) -> None:
        # refused: bools for digital objects; astype(np.float64)
        self.both.write(self.b2)
