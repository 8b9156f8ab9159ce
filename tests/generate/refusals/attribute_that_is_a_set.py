"""Attribute that is a set."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeThatIsASet(Program):
    def begin(self) -> None:
        self.many = {1}

    def control(self) -> None:
        # refused: this cannot be translated; numbers, states, comparisons, arithmetic, calls of functions
        self.many = {1, 2}
        self.c = len(self.many)
