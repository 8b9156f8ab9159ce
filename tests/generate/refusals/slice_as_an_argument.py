"""A function changes an array of which it has a slice."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceAsAnArgument(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0, 3.0])

    def changed(self, part: Any) -> float:
        self.row[1] = self.u
        return float(part[0])

    def control(self) -> None:
        # refused: the function changes an array that also has another name in it; a copy
        self.k = self.changed(self.row[1:])
