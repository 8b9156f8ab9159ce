"""Objects that conditions choose."""

from __future__ import annotations

from helpers.written_programs import Program


class ObjectsThatConditionsChoose(Program):
    def control(self) -> None:
        # refused: the number of objects is not known; a loop; min or max by a key
        found = [each for each in (self.a, self.b) if each.pending > self.u]
        self.k = 1.0 if found else 0.0
