"""Attribute of a number."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeOfANumber(Program):
    def control(self) -> None:
        # refused: an attribute of something that is not known when the code is generated
        self.k = self.u.real
