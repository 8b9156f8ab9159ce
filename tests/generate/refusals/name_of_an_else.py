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
        # refused: on some branches it has no value or another object; give it a value first, or use one name per object
        self.k = found
