"""A dataclass that has no such field."""

from __future__ import annotations

from dataclasses import dataclass

from helpers.written_programs import Program


@dataclass(frozen=True)
class Limits:
    low: float
    high: float = 10.0


class DataclassWithAnotherArgument(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def control(self) -> None:
        # refused: got an unexpected keyword argument 'middle'
        self.limits = Limits(self.u, middle=1.0)  # type: ignore[call-arg]
