"""Whole part is reset."""

from __future__ import annotations

from helpers.written_programs import Program


class WholePartIsReset(Program):
    def begin(self) -> None:
        self.part = self.x._parent

    def control(self) -> None:
        # refused: `reset` of a part is carried out by the host; read, write, reset of an object
        self.part.reset()
