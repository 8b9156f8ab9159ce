"""A list of the elements of a deque."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class ListOfADeque(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: the number of elements of the expression varies; any, all, sum, min, max, len or next of it; a loop
        self.k = [each * 2 for each in self.window][0]
