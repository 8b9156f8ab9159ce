"""Tuples that may be none."""

from __future__ import annotations

from helpers.written_programs import Program


class TuplesThatMayBeNone(Program):
    def begin(self) -> None:
        self.one, self.two = (1, 2), (3, 4)

    def control(self) -> None:
        # refused: the compared tuples may be None; compare their elements
        self.yes = self.one == self.two
        self.one, self.two = None, None
