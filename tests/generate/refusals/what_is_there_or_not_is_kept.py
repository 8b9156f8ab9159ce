"""What is there or not is kept."""

from __future__ import annotations

from helpers.written_programs import Program


class WhatIsThereOrNotIsKept(Program):
    def control(self) -> None:
        # refused: only whether it is None is known on the controller; is None, is not None
        self.yes = self.fan.inhibited
