"""One of two tuples with a number of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class OneOfTwoTuplesOfNumpy(Program):
    def begin(self) -> None:
        self.row = np.zeros(3)

    def control(self) -> None:
        # refused: a tuple with elements other than Python numbers; float(...), int(...)
        self.k = float(((self.row[0], 1.0) if self.n > 1 else (2.0, 3.0))[0])
