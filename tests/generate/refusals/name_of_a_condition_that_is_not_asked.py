"""Name of a condition that is not asked."""

from __future__ import annotations

from helpers.written_programs import Program


class NameOfAConditionThatIsNotAsked(Program):
    def control(self) -> None:
        if self.u > 1.0 and (more := self.u - 1.0) > 2.0:
            self.k = 1.0
        # refused: on some branches it has no value or another object; give it a value first, or use one name per object
        self.k += more
