"""Different objects are returned."""

from __future__ import annotations

from helpers.written_programs import Program


class DifferentObjectsAreReturned(Program):
    # refused: the function returns different objects; one object per call
    def found(self):
        if self.yes:
            return self.a
        return self.b

    def control(self) -> None:
        # refused: NoneType has no 'write' now; give it a value in `setup`
        self.found().write(1.0)
