"""A name that is a number before."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class NamedPart:
    def __init__(self, value: Any) -> None:
        self.value = value


class NameOfOneOfSeveral(Program):
    def begin(self) -> None:
        self.parts = NamedPart(1.0), NamedPart(2.0)

    def control(self) -> None:
        part: Any = 1.0
        self.k = part
        # refused: 'part' means different objects; one name per object
        part = self.parts[self.n]
