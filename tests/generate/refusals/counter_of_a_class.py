"""Counter of a class."""

from __future__ import annotations

from helpers.written_programs import Program


class Helper:
    made = 0


class WithHelper(Program):
    def begin(self) -> None:
        self.helper = Helper()


class CounterOfAClass(WithHelper):
    def control(self) -> None:
        # refused: an attribute of the class Helper is assigned; the attribute belongs to another object
        Helper.made += 1
        self.c = self.helper.made
