"""Type of a caught error."""

from __future__ import annotations

from helpers.written_programs import Program


class TypeOfACaughtError(Program):
    def control(self) -> None:
        try:
            self.k = 1.0 / self.u
        except ArithmeticError as error:
            # refused: this depends on a string that is made at run time, or on a caught error; a state of an Enum, an `except` for each error
            self.c = 1 if type(error) is ZeroDivisionError else 2
