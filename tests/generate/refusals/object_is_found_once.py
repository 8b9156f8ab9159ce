"""Object is found once."""

from __future__ import annotations

from helpers.written_programs import Program


class Helper:
    def __init__(self) -> None:
        self.k = 0.0


class WithHelper(Program):
    def begin(self) -> None:
        self.helper = Helper()


class ObjectIsFoundOnce(WithHelper):
    def found(self) -> Helper:
        self.c += 1
        return self.helper

    def control(self) -> None:
        # refused: finding the target runs code that would run twice; assign it to a name first
        self.found().k += 1.0
