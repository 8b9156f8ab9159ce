"""Number in an array."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NumberInAnArray(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: `is` and `in` of arrays cannot be translated; ==, <, any(), all()
        self.yes = self.x3 is self.y2
