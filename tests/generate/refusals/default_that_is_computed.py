"""A default of a function in a function, which is computed where it is made."""

from __future__ import annotations

from helpers.written_programs import Program


class DefaultThatIsComputed(Program):
    def control(self) -> None:
        # refused: the default of a nested function is computed; an argument
        def added(x: float = self.u) -> float:
            return x + 1.0

        self.k = added()
