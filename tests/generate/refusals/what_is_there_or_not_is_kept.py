"""What is there or not is kept."""

from __future__ import annotations

from helpers.written_programs import Program


class WhatIsThereOrNotIsKept(Program):
    def control(self) -> None:
        # refused: self.yes is no number or state; numbers, states, tuples of them
        self.yes = self.fan.inhibited
