"""zip with an argument that it does not have."""

from __future__ import annotations

from helpers.written_programs import Program


class ZipWithAnotherArgument(Program):
    def control(self) -> None:
        # refused: an argument is given by keyword to `zip`; a positional argument
        for each in zip((1.0,), longest=True):
            self.k = each[0]
