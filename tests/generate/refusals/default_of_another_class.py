"""A default of another class than the values of a dict."""

from __future__ import annotations

from helpers.written_programs import Program

GAINS = {1: 2.0, 3: 4.0}


class DefaultOfAnotherClass(Program):
    def control(self) -> None:
        # refused: the default is not of the class of the dict's values; 0.0 instead of 0
        self.k = GAINS.get(self.n, 0) * 1.0
