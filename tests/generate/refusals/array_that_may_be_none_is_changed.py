"""An array that may be None is changed, and has another name."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class ArrayThatMayBeNoneIsChanged(Program):
    def begin(self) -> None:
        self.grid: Any = np.zeros(2)

    def control(self) -> None:
        if self.n > 3:
            self.grid = None
        if self.grid is not None:
            other = self.grid
            # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
            self.grid[0] += 1.0
            self.k = float(other[0])
