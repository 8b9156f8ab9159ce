"""A function in a function whose names have no value yet."""

from __future__ import annotations

from helpers.written_programs import Program


class NameThatAFunctionHasTooEarly(Program):
    def control(self) -> None:
        def inner() -> float:
            return late * 2.0

        # refused: 'late': on some branches it has no value or another object; give it a value first, or use one name per object
        self.k = inner()
        late = self.u
