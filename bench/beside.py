"""A loop of 1 ms with something beside it, to the same loop without it, in turns (design.md 13.18)."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager

import numpy as np

from bench.against import Row
from bench.face_process import SETTLING, running
from bench.open_page import expect_running
from bench.realtime import take
from bench.report import Doing, Target
from umo.commissioning.latency import Samples
from umo.process.start import Started

Beside = Callable[[Started], AbstractAsyncContextManager[None]]
"""Begins what is beside a station, and ends it."""
OBJECTS = 60
BLOCK = 10.0
"""Duration in s of a measurement."""
LIMIT = 1.05
PARTS = {"waking up + execution": "total", "  waking up alone": "wake", "  execution alone": "work"}
SHOWN = [(name, share) for name in PARTS for share in (50, 99) if (PARTS[name], share) != ("wake", 50)]
"""The rows. A loop that waits busily is awake at the tick: the median of that is 0."""


def compared(beside: Beside, what: str, pairs: int, runner: asyncio.Runner, doing: Doing) -> Iterator[Target]:
    """So many blocks with it and as many without, in turns; which is first changes."""
    rows = {(name, share): Row(name) for name, share in SHOWN}
    sides = Samples(), Samples()
    for number in range(pairs):
        doing(f"the loop, pair {number + 1} of {pairs}")
        found = runner.run(_pair(beside, beside_first=bool(number % 2)))
        for (name, share), row in rows.items():
            with_them, without = (float(np.percentile(getattr(side, PARTS[name]), share)) for side in found)
            row.pairs.append((with_them, without))
        for whole, part in zip(sides, found, strict=True):
            whole.wake, whole.work = np.append(whole.wake, part.wake), np.append(whole.work, part.work)
            whole.missed += part.missed
    for title, side in zip((f"a loop of 1 ms with {what}", "  without"), sides, strict=True):
        yield Target(title, "-", f"{len(side.total):,} periods", f"missed {side.missed:,}")
    for (name, share), row in rows.items():
        here, there = (float(np.median(side)) for side in zip(*row.pairs, strict=True))
        low, high = row.interval
        shown = f"{np.median(row.ratios):.3f} ({low:.3f} to {high:.3f}); {here:.1f} and {there:.1f} us"
        limited = PARTS[name] == "total"
        verdict = "" if not limited else "missed" if low > LIMIT else "met" if high <= LIMIT else "not told apart"
        yield Target(f"{name}, p{share}, to without", f"{LIMIT}" if limited else "-", shown, verdict)


async def _pair(beside: Beside, *, beside_first: bool) -> tuple[Samples, Samples]:
    """A block with it and one without, of one run."""
    with_it, without = Samples(), Samples()
    async with running(OBJECTS, "1 ms") as started:
        if not beside_first:
            await _block(started, without)
        async with beside(started):
            await _block(started, with_it)
        if beside_first:
            await _block(started, without)
    return with_it, without


async def _block(started: Started, into: Samples) -> None:
    await asyncio.sleep(SETTLING)
    frames = started.frames
    assert frames is not None
    frames.read()
    end = time.monotonic() + BLOCK
    while time.monotonic() < end:
        await asyncio.sleep(0.02)
        expect_running(started)
        take(frames, into)
