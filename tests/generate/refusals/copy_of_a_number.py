"""Copy of a number."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class CopyOfANumber(Program):
    def control(self) -> None:
        # refused: an array of one number; np.array([x])
        self.k = float(np.copy(self.u))
