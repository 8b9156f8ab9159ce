"""Field named as a word of c."""

from __future__ import annotations

from helpers.written_programs import Program


class FieldNamedAsAWordOfC(Program):
    def begin(self) -> None:
        self.register = 1.0

    def control(self) -> None:
        # refused: 'register' is not the name of a field in C; letters of ASCII, and no word of C
        self.register = self.u
