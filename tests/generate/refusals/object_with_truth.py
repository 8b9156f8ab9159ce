"""Object with truth."""

from __future__ import annotations

from helpers.written_programs import Program


class Compared:
    def __init__(self, number: float) -> None:
        self.number = number

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Compared) and other.number == self.number

    __hash__ = None  # type: ignore[assignment]

    def __bool__(self) -> bool:
        return self.number > 1.0


class ObjectWithTruth(Program):
    def begin(self) -> None:
        self.one = Compared(1.0)

    def control(self) -> None:
        self.one.number = self.u
        # refused: Compared defines its own truth value; a comparison
        self.c = 1 if self.one else 2
