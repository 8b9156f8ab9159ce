"""Random numbers of the cycle."""

from __future__ import annotations

from helpers.written_programs import Program


class RandomNumbersOfTheCycle(Program):
    def begin(self) -> None:
        self.cycle = self.x._machine.whole if False else self.x

    def control(self) -> None:
        # refused: DigitalSensor has no 'random' now; give it a value in `setup`
        self.k = self.cycle.random.random()
