"""A function in a function whose names have no value yet."""

from __future__ import annotations

from helpers.written_programs import Program


class NameThatAFunctionHasTooEarly(Program):
    def control(self) -> None:
        def inner() -> float:
            return late * 2.0

        # refused: 'late': on some ways it has no value, or another object; give it a value first, a name for each object
        self.k = inner()
        late = self.u
