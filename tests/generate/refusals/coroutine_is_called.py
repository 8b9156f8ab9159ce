"""Coroutine is called."""

from __future__ import annotations

from helpers.written_programs import Program


class CoroutineIsCalled(Program):
    async def moves(self):
        self.k = 1.0

    def control(self) -> None:
        # refused: a sequence runs on the host; functions without await
        self.moves()
