"""A default of a dataclass that is created at each call."""

from __future__ import annotations

from dataclasses import dataclass, field

from helpers.written_programs import Program


@dataclass(frozen=True)
class Limits:
    low: float
    high: float = field(default_factory=float)


class DataclassWhoseDefaultIsMade(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def control(self) -> None:
        # refused: the default of 'high' is created at each call; the argument
        self.limits = Limits(self.u)
