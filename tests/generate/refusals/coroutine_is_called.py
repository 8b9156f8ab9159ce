"""Coroutine is called."""

from __future__ import annotations

from helpers.written_programs import Program


class CoroutineIsCalled(Program):
    async def moves(self):
        self.k = 1.0

    def control(self) -> None:
        # refused: moves: its source is not found, or has changed; `def` in a file of the station
        self.moves()
