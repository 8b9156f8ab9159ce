"""`in` of a deque."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class ElementOfADeque(Program):
    def begin(self) -> None:
        self.window = deque([1, 2], maxlen=2)

    def control(self) -> None:
        # refused: `in` searches something that is not known when the code is generated; a tuple
        self.yes = self.n in self.window
