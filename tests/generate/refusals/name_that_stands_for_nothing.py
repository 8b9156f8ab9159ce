"""Name that stands for nothing."""

from __future__ import annotations

from helpers.written_programs import Program


class NameThatStandsForNothing(Program):
    def control(self) -> None:
        # refused: the name is not defined
        self.k = unknown_name  # noqa: F821
