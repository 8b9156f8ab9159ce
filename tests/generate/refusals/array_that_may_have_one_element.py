"""Array that may have one element."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayThatMayHaveOneElement(Program):
    def begin(self) -> None:
        self.one = np.zeros(1)
        self.more = np.zeros(3)

    def control(self) -> None:
        # refused: the array may have one or more elements in Python; np.zeros(n), np.full(n, ...)
        self.k = float(len(self.one))
        self.one = self.one + self.more
