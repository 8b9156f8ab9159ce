"""Whole numbers that numpy rounds."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class WholeNumbersRoundedByNumpy(Program):
    def begin(self) -> None:
        self.counts = np.array([1, 2])

    def control(self) -> None:
        # refused: integers are rounded, which gives floats in some versions of numpy; them
        self.k = float(np.floor(self.counts).sum())
