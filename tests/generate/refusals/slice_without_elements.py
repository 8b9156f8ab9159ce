"""A slice without elements."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceWithoutElements(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0, 3.0])

    def control(self) -> None:
        # refused: the slice has no elements; other ends
        self.k = float(self.row[3:].sum())
