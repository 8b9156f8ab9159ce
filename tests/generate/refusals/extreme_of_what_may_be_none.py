"""The extreme of elements that may be None."""

from __future__ import annotations

from helpers.written_programs import Program


class ExtremeOfWhatMayBeNone(Program):
    def control(self) -> None:
        # refused: an element may be None; `if x is not None`
        self.k = max(each for each in (self.u, self.maybe) if self.n > 1)  # type: ignore[type-var,assignment]
