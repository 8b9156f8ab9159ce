"""A function that yields."""

from __future__ import annotations

from collections.abc import Iterator

from helpers.written_programs import Program


class FunctionThatYields(Program):
    def great_ones(self) -> Iterator[float]:
        yield from (each for each in (self.u, 1.0) if each > 0.0)

    def control(self) -> None:
        # refused: a generator function is called; sum(... for ...), a loop
        self.k = max(self.great_ones())
