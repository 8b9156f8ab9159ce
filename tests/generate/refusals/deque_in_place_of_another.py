"""A deque in the place of another one."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeInPlaceOfAnother(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: deque cannot be translated; functions of Python code, math
        self.window = deque(maxlen=2)
