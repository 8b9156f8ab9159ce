"""Name of an else."""

from __future__ import annotations

from helpers.written_programs import Program


class NameOfAnElse(Program):
    def control(self) -> None:
        for i in range(3):
            if i > self.n:
                break
        else:
            found = 1.0
        # refused: on some ways it has no value, or another object; give it a value first, a name for each object
        self.k = found
