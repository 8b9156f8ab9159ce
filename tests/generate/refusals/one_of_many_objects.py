"""One of more objects than are written out."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class ManyPart:
    def __init__(self, value: Any) -> None:
        self.value = value


class OneOfManyObjects(Program):
    def begin(self) -> None:
        self.parts = tuple(ManyPart(float(n)) for n in range(40))

    def control(self) -> None:
        # refused: the object is chosen at run time; for n, each in enumerate(...): if n == place: ...
        self.k = self.parts[self.n].value
