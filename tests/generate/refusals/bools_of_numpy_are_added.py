"""Bools of numpy are added."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class BoolsOfNumpyAreAdded(Program):
    def begin(self) -> None:
        self.marks = np.array([True, True])

    def control(self) -> None:
        # refused: a numpy bool and another bool are combined by arithmetic; int(...), and, or
        self.c = int(self.marks[0] + self.marks[1])
