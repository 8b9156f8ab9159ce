"""Attribute becomes an object."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeBecomesAnObject(Program):
    def begin(self) -> None:
        self.which = self.a

    def control(self) -> None:
        # refused: self.which is not a number or a state; numbers, states, tuples of these
        self.which = self.b
