"""A default that has its numbers from another array, which anybody may change."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program

ROW = np.array([1.0, 2.0, 3.0])


class DefaultThatIsAPartOfAnArray(Program):
    def total(self, row: Any = ROW[::2]) -> float:
        return float(row.sum())

    def control(self) -> None:
        # refused: __defaults__ of DefaultThatIsAPartOfAnArray.total is a view of another array; a tuple
        self.k = self.total()
