"""Attribute that is not there yet."""

from __future__ import annotations

from helpers.written_programs import Program


class AttributeThatIsNotThereYet(Program):
    def control(self) -> None:
        # refused: AttributeThatIsNotThereYet has no 'later' now; give it a value in `setup`
        self.k = self.later
