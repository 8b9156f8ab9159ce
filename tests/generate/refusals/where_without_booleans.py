"""Where without booleans."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class WhereWithoutBooleans(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: the condition of `where` is not an array of bools
        self.x3 = np.where(self.x3, 1.0, 2.0)
