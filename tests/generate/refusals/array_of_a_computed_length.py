"""Array of a computed length."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayOfAComputedLength(Program):
    def control(self) -> None:
        # refused: the length of the array is not known when the code is generated; np.zeros(3)
        self.k = np.zeros(self.n).sum()
