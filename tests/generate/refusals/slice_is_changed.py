"""A slice of an array is changed in place."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceIsChanged(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0, 3.0])

    def control(self) -> None:
        part = self.row[1:]
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        part += 1.0
