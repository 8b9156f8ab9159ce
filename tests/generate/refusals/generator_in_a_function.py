"""A function in a function that gives one value after the other."""

from __future__ import annotations

from helpers.written_programs import Program


class GeneratorInAFunction(Program):
    def control(self) -> None:
        # refused: the nested function is decorated or a generator; a method
        def several():
            yield self.u

        self.k = max(several())
