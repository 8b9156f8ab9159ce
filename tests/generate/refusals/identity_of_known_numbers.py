"""Identity of known numbers."""

from __future__ import annotations

from helpers.written_programs import Program

THOUSAND = 1000
OTHER = 1000


class IdentityOfKnownNumbers(Program):
    def control(self) -> None:
        # refused: numbers or texts are compared by `is`; ==
        self.yes = THOUSAND is OTHER
