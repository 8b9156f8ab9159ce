"""Getattribute of its own."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class Looked:
    """Every attribute is another one when it is read."""

    def __init__(self) -> None:
        self.k = 1.0

    def __getattribute__(self, name: str) -> Any:
        found = object.__getattribute__(self, name)
        return found + 1.0 if name == "k" else found


class GetattributeOfItsOwn(Program):
    def begin(self) -> None:
        self.looked = Looked()

    def control(self) -> None:
        # refused: Looked has a __getattribute__; an attribute, a property or a method
        self.k = self.looked.k
