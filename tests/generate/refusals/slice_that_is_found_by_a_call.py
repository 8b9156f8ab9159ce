"""A slice of an array that a function finds, which changes something."""

from __future__ import annotations

from typing import Any

import numpy as np

from helpers.written_programs import Program


class SliceThatIsFoundByACall(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0, 3.0])

    def found(self) -> Any:
        self.c += 1
        return self.row

    def control(self) -> None:
        # refused: finding the target runs code that changes something; assign it to a name first
        self.found()[1:] = self.u
