"""More texts than a byte has numbers."""

from __future__ import annotations

from helpers.written_programs import Program

WORDS = tuple(f"word {n}" for n in range(300))


class ManyTexts(Program):
    def begin(self) -> None:
        self.phase = "off"

    def control(self) -> None:
        # refused: the machine has more than 256 texts; members of an Enum
        self.phase = "on" if self.u > 1.0 else "off"
        # refused: the machine has more than 256 texts; members of an Enum
        self.yes = self.phase in WORDS
