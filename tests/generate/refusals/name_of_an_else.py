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
        # refused: it is used before it has a value on every way; give it a value first
        self.k = found
