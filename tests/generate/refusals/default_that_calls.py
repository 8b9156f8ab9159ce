"""A default that is computed by a function."""

from __future__ import annotations

from helpers.written_programs import Program


class DefaultThatCalls(Program):
    def other(self) -> float:
        self.c += 1
        return self.u

    def control(self) -> None:
        # refused: an argument is computed; assign it to a name first
        self.k = max((each for each in (self.u, self.k) if each > 1.0), default=self.other())
