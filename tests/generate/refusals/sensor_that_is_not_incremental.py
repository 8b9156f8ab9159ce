"""Sensor that is not incremental."""

from __future__ import annotations

from helpers.written_programs import Program


class SensorThatIsNotIncremental(Program):
    def control(self) -> None:
        # refused: x is not declared incremental; incremental=True
        self.x.referenced()
