"""Programs that serve beside machines until they are stopped: faces, gateways, routers, recorders."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any

from umo.system.realtime import drop_realtime

NICENESS = 15
"""By how much their priority is below that of a usual program."""


def step_back() -> None:
    """Leave the processors to machines: an ordinary process, of a low priority."""
    drop_realtime(NICENESS)


async def until_stopped(work: Coroutine[Any, Any, object]) -> None:
    """Work until it ends, or SIGINT or SIGTERM cancels it."""
    serving = asyncio.ensure_future(work)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, serving.cancel)
    with suppress(asyncio.CancelledError):
        await serving
