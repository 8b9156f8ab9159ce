"""Constant array is changed."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ConstantArrayIsChanged(Program):
    def begin(self) -> None:
        self.GAINS = np.ones(3)

    def control(self) -> None:
        # refused: an array that is known when the code is generated is changed; a new array
        self.GAINS += self.u
        self.k = float(self.GAINS[0])
