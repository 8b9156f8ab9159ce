"""Two loops over a deque in one expression."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class TwoLoopsOverADeque(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: the expression has two loops; a loop for each
        self.yes = any(one > other for one in self.window for other in self.window)
