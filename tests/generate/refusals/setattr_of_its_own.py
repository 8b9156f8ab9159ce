"""Setattr of its own."""

from __future__ import annotations

from helpers.written_programs import Program


class Guarded:
    def __init__(self) -> None:
        self.k = 0.0

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, name, 7.0)


class SetattrOfItsOwn(Program):
    def begin(self) -> None:
        self.guarded = Guarded()

    def control(self) -> None:
        # refused: Guarded has a __setattr__, or is frozen; the attribute belongs to another object
        self.guarded.k = self.u
