"""A square root of booleans, of 16 bits."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SquareRootOfBooleans(Program):
    def begin(self) -> None:
        self.row, self.mask = np.array([0.5, 1.5]), np.array([True, False])

    def control(self) -> None:
        # refused: numpy computes this operation on bools in 16 bits, or not at all; astype(float)
        self.row = np.sqrt(self.mask)
