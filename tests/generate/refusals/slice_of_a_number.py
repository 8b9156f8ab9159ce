"""A slice of a number."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceOfANumber(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0, 3.0])

    def control(self) -> None:
        # refused: the slice is not that of a tuple, a list or an array; a tuple, a list; a loop
        self.k = self.u[1:]  # type: ignore[index]
