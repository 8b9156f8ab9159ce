"""`~` of a bool that may be one of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class InverseOfABoolPerhapsOfNumpy(Program):
    def begin(self) -> None:
        self.row, self.mask = np.array([0.5, 1.5]), np.array([True, False])

    def control(self) -> None:
        # refused: ~ of a bool that may be a numpy bool is not the same in C; not
        self.yes = bool(~(self.yes if self.u > 1.0 else self.mask.any()))
