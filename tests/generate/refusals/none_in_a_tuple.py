"""What may be None in a tuple."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Both(NamedTuple):
    first: float
    second: float


class NoneInATuple(Program):
    def begin(self) -> None:
        self.both = Both(0.0, 0.0)
        self.last: float | None = None

    def control(self) -> None:
        self.last = None if self.n > 3 else self.u
        # refused: a value that may be None stands in a tuple; `if x is not None`
        self.both = Both(self.u, self.last)
        self.k = self.both.first * 1.0
