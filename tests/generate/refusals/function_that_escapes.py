"""A function in a function that another one calls."""

from __future__ import annotations

from helpers.written_programs import Program


class FunctionThatEscapes(Program):
    def call(self, function):
        # refused: a function that was defined inside another one is called; a method
        return function(1.0)

    def control(self) -> None:
        def inner(x: float) -> float:
            return x * self.u

        self.k = self.call(inner)
