"""Mask of numbers."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program
from umo import Vector


class MaskOfNumbers(Program):
    def begin(self) -> None:
        self.both = Vector([self.a, self.b])

    def control(self) -> None:
        # refused: the mask is not an array of 2 bools
        self.both.write(1.0, where=np.ones(2))
