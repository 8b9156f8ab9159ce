"""An array that is rolled by a number that is computed."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayRolledByWhatIsComputed(Program):
    def begin(self) -> None:
        self.row, self.mask = np.array([0.5, 1.5]), np.array([True, False])

    def control(self) -> None:
        # refused: `np.roll` moves by an unknown number; np.roll(x, 1)
        self.row = np.roll(self.row, self.n)
