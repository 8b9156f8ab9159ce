"""Number where a tuple was."""

from __future__ import annotations

from helpers.written_programs import Program


class NumberWhereATupleWas(Program):
    def begin(self) -> None:
        self.pair = (1.0, 2.0)

    def control(self) -> None:
        # refused: it is assigned, and is not a number or a state; numbers, states, tuples of numbers
        self.pair = self.u
