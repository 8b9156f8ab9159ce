"""One list at two places."""

from __future__ import annotations

from helpers.written_programs import Program


class OneListAtTwoPlaces(Program):
    def begin(self) -> None:
        self.one = [0.0, 0.0]
        self.two = self.one

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.one[0] = self.u
        self.k = self.two[0]
