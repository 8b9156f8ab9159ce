"""A dataclass in the place of a tuple."""

from __future__ import annotations

from dataclasses import dataclass

from helpers.written_programs import Program


@dataclass(frozen=True)
class Limits:
    low: float
    high: float = 10.0


class ElementsOfADataclass(Program):
    def begin(self) -> None:
        self.limits = Limits(1.0)

    def control(self) -> None:
        self.limits = Limits(self.u)
        # refused: a Limits has no elements; its fields
        self.k, self.c = self.limits  # type: ignore[misc]
