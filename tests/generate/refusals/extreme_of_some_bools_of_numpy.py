"""The extreme of bools of numpy."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ExtremeOfSomeBoolsOfNumpy(Program):
    def begin(self) -> None:
        self.able = np.zeros(3, dtype=np.bool_)

    def control(self) -> None:
        # refused: a minimum or maximum of numpy bools cannot be translated; and, or, bool(...)
        self.yes = bool(max((each for each in self.able if self.n > 1), default=False))
