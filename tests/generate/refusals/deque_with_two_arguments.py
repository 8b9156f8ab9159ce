"""A method of a deque without its argument."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeWithTwoArguments(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: `append` of a deque cannot be called with 0 arguments; 1
        self.window.append()  # type: ignore[call-arg]
