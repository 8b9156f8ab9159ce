"""Attribute of one of two."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeOfOneOfTwo(Program):
    def control(self) -> None:
        # refused: a AttributeOfOneOfTwo is not a number or a state on the controller; an Enum
        (self if self.yes else self.x).k = 1.0
