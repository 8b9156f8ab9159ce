"""A slice is added to, and computing the value changes something."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceWithAValueThatChanges(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0, 3.0])

    def found(self) -> float:
        self.c += 1
        return self.u

    def control(self) -> None:
        # refused: computing the value changes something; assign it to a name first
        self.row[1:] += self.found()
