"""One list of a class."""

from __future__ import annotations

from functools import cached_property

from helpers.written_programs import Program


class Helper:
    made = 0
    shared = [1.0, 2.0]

    def __init__(self) -> None:
        self.k = 0.0
        self._hidden = 1.0

    @property
    def doubled(self) -> float:
        return 2.0 * self.k

    @doubled.setter
    def doubled(self, value: float) -> None:
        self.k = value / 2.0

    @cached_property
    def once(self) -> float:
        return self.k + 1.0


class OneListOfAClass(Program):
    def begin(self) -> None:
        self.p, self.q = Helper(), Helper()

    def control(self) -> None:
        # refused: an array is changed in place, and may have another name; a new array: x = x + 1, np.where, a copy
        self.p.shared[0] = self.u
        self.k = self.q.shared[0]
