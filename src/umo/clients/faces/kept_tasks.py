"""Tasks that nobody awaits: asyncio itself does not keep them."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


class KeptTasks(set[asyncio.Task[Any]]):
    """Tasks that have not ended."""

    def begin(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        task = asyncio.create_task(work)
        self.add(task)
        task.add_done_callback(self.discard)
        return task

    def cancel(self) -> None:
        for task in self:
            task.cancel()

    async def end(self) -> None:
        """Cancel them, and wait for their ends."""
        self.cancel()
        await asyncio.gather(*self, return_exceptions=True)
