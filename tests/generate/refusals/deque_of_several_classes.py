"""Whole numbers and floats in a deque."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Program


class DequeOfSeveralClasses(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=2)

    def control(self) -> None:
        # refused: the deque has elements of several classes; one class for all elements, float(...)
        self.window.append(self.n)
