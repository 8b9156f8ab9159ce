"""A deque that grows."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeWithoutALength(Program):
    def begin(self) -> None:
        self.window = deque([1.0])

    def control(self) -> None:
        # refused: the deque has no `maxlen`; deque(maxlen=n), at most 4096 numbers
        self.window.append(self.u)
