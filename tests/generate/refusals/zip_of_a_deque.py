"""`zip` of a deque, whose number of elements changes."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class ZipOfADeque(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: `zip` is applied to something with a varying number of elements; a loop over range(len(...))
        for one, other in zip(self.window, (1.0, 2.0), strict=False):
            self.k += one * other
