"""Keeps tasks that no code awaits, because asyncio itself does not keep references to them."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


class KeptTasks(set[asyncio.Task[Any]]):
    """The tasks that have not ended yet."""

    def begin(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        task = asyncio.create_task(work)
        self.add(task)
        task.add_done_callback(self.discard)
        return task

    def cancel(self) -> None:
        for task in self:
            task.cancel()

    async def end(self) -> None:
        """Cancel the tasks, and wait until they have ended."""
        self.cancel()
        await asyncio.gather(*self, return_exceptions=True)
