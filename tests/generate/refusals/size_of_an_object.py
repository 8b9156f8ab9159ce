"""Size of an object."""

from __future__ import annotations

from helpers.written_programs import Program


class Sized:
    def __init__(self) -> None:
        self.size = 1

    def __len__(self) -> int:
        return self.size


class SizeOfAnObject(Program):
    def begin(self) -> None:
        self.sized = Sized()

    def control(self) -> None:
        self.sized.size = self.n % 3
        # refused: len is applied to an object whose class defines its elements; a list, a tuple
        self.c = len(self.sized)
