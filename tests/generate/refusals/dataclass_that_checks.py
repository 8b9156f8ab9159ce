"""A dataclass that runs code when it is created."""

from __future__ import annotations

from dataclasses import dataclass

from helpers.written_programs import Program


@dataclass(frozen=True)
class Limits:
    low: float
    high: float = 10.0

    def __post_init__(self) -> None:
        assert self.low < self.high


class DataclassThatChecks(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def control(self) -> None:
        # refused: a Limits is created, and is not frozen or has its own code for that; a frozen dataclass with only fields, methods and properties
        self.limits = Limits(self.u)
