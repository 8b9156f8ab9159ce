"""Acknowledged object."""

from __future__ import annotations

from helpers.written_programs import Program


class AcknowledgedObject(Program):
    def control(self) -> None:
        # refused: `acknowledge` of an object cannot be translated; read, write, reset, quality, pending
        self.fan.acknowledge()
