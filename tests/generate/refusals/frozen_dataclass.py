"""Frozen dataclass."""

from __future__ import annotations

from dataclasses import dataclass

from helpers.written_programs import Program


@dataclass(frozen=True)
class Frozen:
    k: float = 1.0


class FrozenDataclass(Program):
    def begin(self) -> None:
        self.frozen = Frozen()

    def control(self) -> None:
        # refused: Frozen has a __setattr__, or is frozen; the attribute belongs to another object
        self.frozen.k = self.u  # type: ignore[misc]
