"""`in` of an array, which compares all its elements."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NumberAmongAnArray(Program):
    def begin(self) -> None:
        self.row = np.zeros(2)

    def control(self) -> None:
        # refused: `in` searches something that is not known when the code is generated; a tuple
        self.yes = 1.0 in self.row
