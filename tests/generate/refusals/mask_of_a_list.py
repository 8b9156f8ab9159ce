"""A list has no places that booleans choose."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class MaskOfAList(Program):
    def begin(self) -> None:
        self.row, self.x3 = [0.5, 1.0, 2.0], np.zeros(3)

    def control(self) -> None:
        # refused: the value is not a number
        self.row[self.x3 >= 0.0] = 1.0  # type: ignore[call-overload]
