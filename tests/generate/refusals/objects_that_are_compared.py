"""Objects that are compared."""

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


class ObjectsThatAreCompared(Program):
    def begin(self) -> None:
        self.one, self.other = Compared(1.0), Compared(1.0)

    def control(self) -> None:
        self.one.number = self.u
        # refused: the class of these objects defines which are equal; `is`
        self.c = int(self.one == self.other)
