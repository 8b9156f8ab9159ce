"""Two deques are compared."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeIsCompared(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)
        self.other = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: a deque is compared; its elements, one by one
        self.yes = self.window == self.other
