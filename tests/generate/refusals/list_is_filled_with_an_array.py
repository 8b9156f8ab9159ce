"""List is filled with an array."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ListIsFilledWithAnArray(Program):
    def begin(self) -> None:
        self.row = [1.0, 2.0]

    def control(self) -> None:
        # refused: it is assigned, and is not a number or a state; numbers, states, tuples of numbers
        self.row = np.zeros(2)
