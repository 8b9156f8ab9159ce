"""A new array that has two names from the start."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class TwoNamesInOneAssignment(Program):
    def control(self) -> None:
        one = other = np.array([self.u, 2.0])
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        one += 1.0
        self.k = float(other[0])
