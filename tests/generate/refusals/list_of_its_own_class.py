"""List of its own class."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class Sevens(list[float]):
    def __getitem__(self, place: Any) -> Any:
        return 7.0


class ListOfItsOwnClass(Program):
    def begin(self) -> None:
        self.row = Sevens([1.0, 2.0])

    def control(self) -> None:
        # refused: this is an element of something that is not a list or an array in C; a list of floats or of ints, np.zeros(n)
        self.row[0] = self.u
        # refused: Sevens defines its elements itself; a list, a tuple
        self.k = self.row[0] * 1.0
