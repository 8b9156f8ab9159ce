"""Python raises where a deque is changed that a loop goes through."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeIsChangedInItsLoop(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: the loop changes the deque that it iterates over; range(len(...))
        for each in self.window:
            self.window.append(each)
