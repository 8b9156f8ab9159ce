"""A deque that is rotated by a computed number."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeIsRotatedFar(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: `rotate` is called with a number other than 1 or -1; a loop with rotate(1)
        self.window.rotate(self.n)
