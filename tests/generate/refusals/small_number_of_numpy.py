"""Small number of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SmallNumberOfNumpy(Program):
    def begin(self) -> None:
        self.small = np.float32(1.5)

    def control(self) -> None:
        # refused: small is a float32 of numpy; float(...), np.float64
        self.k = self.small * 1.0
