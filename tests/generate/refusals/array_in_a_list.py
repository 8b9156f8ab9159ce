"""Array in a list."""

from __future__ import annotations

import numpy as np

from helpers.written_programs import Program


class ArrayInAList(Program):
    def begin(self) -> None:
        self.one, self.other = np.zeros(2), np.ones(2)
        self.both = [self.one, self.other]

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.one[0] = self.u
        for each in self.both:
            self.k += float(each[0])
