"""Loop over a field that is rebound."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program

ONES = np.ones(3)


class LoopOverAFieldThatIsRebound(Program):
    def begin(self) -> None:
        self.row = np.ones(3)

    def replace(self) -> None:
        self.row = ONES * 10.0

    def control(self) -> None:
        # refused: the loop assigns the name that it iterates over; another name for the new value
        for each in self.row:
            self.k += float(each)
            self.replace()
