"""View of an array."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ViewOfAnArray(Program):
    def begin(self) -> None:
        self.row = np.zeros(4)
        self.head = self.row[:2]

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.row[1] = self.u
        self.k = float(self.head[1])
