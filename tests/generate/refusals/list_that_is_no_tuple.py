"""List that is no tuple."""

from __future__ import annotations

from helpers.written_programs import Program


class ListThatIsNoTuple(Program):
    def control(self) -> None:
        # refused: a tuple is compared with something other than a tuple; compare their elements
        self.c = int([self.n, 1] == (self.n, 1))
