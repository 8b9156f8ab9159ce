"""A default of another class than the values of a dict."""

from __future__ import annotations

from helpers.written_programs import Program

GAINS = {1: 2.0, 3: 4.0}


class DefaultOfAnotherClass(Program):
    def control(self) -> None:
        # refused: a default of another class than the values of the dict; 0.0 in the place of 0
        self.k = GAINS.get(self.n, 0) * 1.0
