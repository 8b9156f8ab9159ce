"""Which of several objects it is, is computed."""

from __future__ import annotations

from helpers.written_programs import Program


class Pump:
    def __init__(self) -> None:
        self.hours = 0.0


class OneOfSeveralObjects(Program):
    def begin(self) -> None:
        self.pumps = (Pump(), Pump())

    def control(self) -> None:
        # refused: which of several objects it is, is not known when the code is generated; for n, each in enumerate(...): if n == place: ...
        self.pumps[self.n % 2].hours += 1.0
