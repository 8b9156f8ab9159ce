"""Power of an array."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class PowerOfAnArray(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: this power of an array cannot be translated; ** -1, 0, 0.5, 1, 2; of whole numbers 0, 1, 2, 3 ...; x * x * x
        self.x3 = self.x3**3
