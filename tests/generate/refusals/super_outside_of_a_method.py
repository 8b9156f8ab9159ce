"""Super outside of a method."""

from __future__ import annotations

from helpers.written_programs import Program


def outside():
    # refused: super() is called outside of a method
    return super().gain()


class SuperOutsideOfAMethod(Program):
    def control(self) -> None:
        self.k = outside()
