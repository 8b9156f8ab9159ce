"""Functions for programs that run in the background of machines until they are stopped: faces, gateways, routers,
recorders."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any

from umo.cycle.insisting import asked_by_signals
from umo.system.realtime import drop_realtime
from umo.system.streams import limit_waits

NICENESS = 15
"""Niceness of these programs. Their priority is lower than that of an ordinary program."""


def step_back() -> None:
    """Run as an ordinary process with low priority, so that machines have the processors."""
    drop_realtime(NICENESS)
    limit_waits()


async def until_stopped(work: Coroutine[Any, Any, object]) -> None:
    """Run work until it ends, or until SIGINT or SIGTERM cancels it. A further signal stops code that does not react to
    the first signal."""
    serving = asyncio.ensure_future(work)
    loop = asyncio.get_running_loop()
    with asked_by_signals(lambda: loop.call_soon_threadsafe(serving.cancel)), suppress(asyncio.CancelledError):
        await serving
