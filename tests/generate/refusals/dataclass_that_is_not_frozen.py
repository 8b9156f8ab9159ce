"""An object that is made in each period."""

from __future__ import annotations

from dataclasses import dataclass

from helpers.written_programs import Program


@dataclass
class Limits:
    low: float
    high: float = 10.0


class DataclassThatIsNotFrozen(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def control(self) -> None:
        # refused: a Limits is created, and is not frozen or has its own code for that; a frozen dataclass with only fields, methods and properties
        self.limits = Limits(self.u)
