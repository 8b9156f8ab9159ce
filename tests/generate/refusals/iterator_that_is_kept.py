"""What gives its elements once has a name."""

from __future__ import annotations

from helpers.written_programs import Program

ROW = (1.0, 2.0)


class IteratorThatIsKept(Program):
    def control(self) -> None:
        # refused: the result of `zip` is stored: it can be iterated only once; the head of a loop, list(...)
        pairs = zip(ROW, ROW)
        self.k = sum(a * b for a, b in pairs)
