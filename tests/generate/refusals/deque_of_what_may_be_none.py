"""A deque of numbers that may be None."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeOfWhatMayBeNone(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: the deque has elements other than Python numbers; float(...), int(...)
        self.window.append(self.maybe)  # type: ignore[arg-type]
