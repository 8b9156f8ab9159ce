"""Caught error as an argument."""

from __future__ import annotations

from helpers.written_programs import Program


class CaughtErrorAsAnArgument(Program):
    def its_class(self, error: Exception) -> int:
        # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
        return 1 if isinstance(error, ZeroDivisionError) else 2

    def control(self) -> None:
        try:
            self.k = 1.0 / self.u
        except ArithmeticError as error:
            self.c = self.its_class(error)
