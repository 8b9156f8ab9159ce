"""Extreme of bools of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ExtremeOfBoolsOfNumpy(Program):
    def begin(self) -> None:
        self.x3, self.y2, self.i3, self.b3 = (
            np.zeros(3),
            np.zeros(2),
            np.zeros(3, dtype=np.int64),
            np.zeros(3, dtype=np.bool_),
        )

    def control(self) -> None:
        # refused: a minimum or maximum of numpy bools cannot be translated; and, or, bool(...)
        self.yes = max(self.b3[0], self.b3[1])
