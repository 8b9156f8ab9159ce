"""A place in a deque that is no whole number."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeAtARealPlace(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: an index into a deque must be an integer
        self.k = self.window[self.u]  # type: ignore[index]
