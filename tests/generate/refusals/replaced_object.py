"""`replace` of a dataclass that is not frozen."""

from __future__ import annotations

from dataclasses import dataclass, replace

from helpers.written_programs import Program


@dataclass
class Limits:
    low: float
    high: float = 10.0


class ReplacedObject(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def control(self) -> None:
        # refused: `replace` is applied to something that is not a frozen dataclass; a frozen dataclass
        self.k = replace(self.limits, low=self.u).low
