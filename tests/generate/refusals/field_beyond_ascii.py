"""Field beyond ascii."""

from __future__ import annotations

from helpers.written_programs import Program


class FieldBeyondAscii(Program):
    def begin(self) -> None:
        self.grün, self.grön = 1.0, 2.0

    def control(self) -> None:
        # refused: 'grün' is not the name of a field in C; letters of ASCII, and no word of C
        self.k = self.grün + self.grön
