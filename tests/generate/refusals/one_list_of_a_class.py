"""One list of a class."""

from __future__ import annotations

from helpers.written_programs import Program


class Helper:
    shared = [1.0, 2.0]


class OneListOfAClass(Program):
    def begin(self) -> None:
        self.p, self.q = Helper(), Helper()

    def control(self) -> None:
        # refused: an array that may have another name is changed in place; a new array: x = x + 1, np.where, a copy
        self.p.shared[0] = self.u
        self.k = self.q.shared[0]
