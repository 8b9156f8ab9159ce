"""Counter of a class."""

from __future__ import annotations

from functools import cached_property

from helpers.written_programs import Program


class Helper:
    made = 0
    shared = [1.0, 2.0]

    def __init__(self) -> None:
        self.k = 0.0
        self._hidden = 1.0

    @property
    def doubled(self) -> float:
        return 2.0 * self.k

    @doubled.setter
    def doubled(self, value: float) -> None:
        self.k = value / 2.0

    @cached_property
    def once(self) -> float:
        return self.k + 1.0


class WithHelper(Program):
    def begin(self) -> None:
        self.helper = Helper()


class CounterOfAClass(WithHelper):
    def control(self) -> None:
        # refused: an attribute of the class Helper is assigned; an attribute of an object of its own
        Helper.made += 1
        self.c = self.helper.made
