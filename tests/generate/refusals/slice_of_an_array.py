"""A slice of an array is another name for its elements."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class SliceOfAnArray(Program):
    def begin(self) -> None:
        self.row = np.zeros(3)

    def control(self) -> None:
        # refused: a slice of what is no tuple and no list; a tuple, a list; a loop
        self.k = float(self.row[1:].sum())
