"""`_replace` of a field that there is not."""

from __future__ import annotations

from typing import NamedTuple

from helpers.written_programs import Program


class Couple(NamedTuple):
    first: float
    second: float


class FieldThatARecordHasNot(Program):
    def begin(self) -> None:
        self.pair = Couple(1.0, 2.0)

    def control(self) -> None:
        # refused: the arguments do not match the fields of Couple; first, second
        self.k = self.pair._replace(third=self.u).first  # type: ignore[call-arg]
