"""Starred name is assigned."""

from __future__ import annotations

from helpers.written_programs import Program


class StarredNameIsAssigned(Program):
    def control(self) -> None:
        # refused: this cannot be assigned to; names, attributes, elements
        for *each, last in ((1.0, 2.0),):
            self.k = last
