"""Loop over what is rebound."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program

ONES = np.ones(3)


class LoopOverWhatIsRebound(Program):
    def control(self) -> None:
        values = np.zeros(3) + self.u
        # refused: the loop assigns the name that it iterates over; another name for the new value
        for each in values:
            self.k += float(each)
            values = ONES * 10.0
        self.k += float(values[0])
