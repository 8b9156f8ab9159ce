"""A method of a deque that cannot be translated."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeThatIsSorted(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: `reverse` of a deque cannot be translated; append, appendleft, pop, popleft, clear, extend, rotate, maxlen
        self.window.reverse()
