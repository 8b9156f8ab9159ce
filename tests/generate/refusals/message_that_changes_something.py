"""Message that changes something."""

from __future__ import annotations

from contextlib import suppress

from helpers.written_programs import Program


class MessageThatChangesSomething(Program):
    def bump(self) -> float:
        self.k += 1.0
        return self.k

    def control(self) -> None:
        with suppress(ValueError):
            if self.u > 1.0:
                # refused: a call in a text that a controller does not have; a name for it first
                raise ValueError(f"{self.bump()}")
