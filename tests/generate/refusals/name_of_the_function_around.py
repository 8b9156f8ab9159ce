"""A function in a function that assigns a name of the one around it."""

from __future__ import annotations

from helpers.written_programs import Program


class NameOfTheFunctionAround(Program):
    def control(self) -> None:
        count = 0

        def inner() -> None:
            # refused: this statement cannot be translated; if, for, while, try, raise, return, assignments
            nonlocal count
            count += 1

        inner()
        self.c = count
