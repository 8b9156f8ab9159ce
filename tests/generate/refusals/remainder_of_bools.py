"""Remainder of bools."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class RemainderOfBools(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: this arithmetic of arrays cannot be translated; +, -, *, /, //, %, **, & and | of booleans
        self.x3 = self.b3 % self.b3
