"""Attribute with texts and numbers."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeWithTextsAndNumbers(Program):
    def begin(self) -> None:
        self.said = "no"

    def control(self) -> None:
        self.said = "yes"
        # refused: said has texts and other values; one name per type
        self.said = self.u
