"""Comparisons of numpy are added."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ComparisonsOfNumpyAreAdded(Program):
    def begin(self) -> None:
        self.row = np.array([1.0, 2.0])

    def control(self) -> None:
        within = 0.0 < self.row[0] < self.u
        # refused: a numpy bool and another bool are combined by arithmetic; int(...), and, or
        self.c = int(within + within)
