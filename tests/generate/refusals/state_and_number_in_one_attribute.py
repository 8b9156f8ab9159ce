"""State and number in one attribute."""

from __future__ import annotations

from helpers.written_programs import Program


class StateAndNumberInOneAttribute(Program):
    def begin(self) -> None:
        self.pair: tuple[int, int] = (1, 2)

    def control(self) -> None:
        # refused: it is assigned, and is not a number or a state; numbers, states, tuples of numbers
        self.pair = (self.u, self.k)
