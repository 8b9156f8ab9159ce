"""What may be None in an array: numpy makes it NaN."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NoneInAnArray(Program):
    def begin(self) -> None:
        self.x3 = np.zeros(3)

    def control(self) -> None:
        # refused: a value that may be None stands next to an array or in one; `if x is not None`
        self.x3[:] = self.maybe  # type: ignore[call-overload]
