"""What may be None as a bound: numpy takes it for none."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class NoneAsABound(Program):
    def control(self) -> None:
        # refused: a value that may be None stands next to an array or in one; `if x is not None`
        self.k = float(np.clip(self.u, self.maybe, 5.0))
