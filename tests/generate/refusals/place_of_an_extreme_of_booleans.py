"""The place of an extreme of booleans."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class PlaceOfAnExtremeOfBooleans(Program):
    def begin(self) -> None:
        self.row, self.mask = np.array([0.5, 1.5]), np.array([True, False])

    def control(self) -> None:
        # refused: the index of a minimum or maximum of bools cannot be translated; a loop
        self.c = int(np.argmax(self.mask))
