"""Raise in a function that a handler calls."""

from __future__ import annotations

from helpers.written_programs import Program


class RaiseInAFunctionThatAHandlerCalls(Program):
    def again(self) -> None:
        # refused: `raise` without an error stands outside of `except`
        raise

    def control(self) -> None:
        try:
            self.k = 1.0 / self.u
        except ZeroDivisionError:
            self.again()
