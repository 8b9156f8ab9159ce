"""What the faces cost: processor time and memory of each beside a station of 60 and of 1,000 objects, with a client of
another project that takes everything; and a loop of 1 ms with all of them and their clients, to without, in turns.

Half of the objects change in every period. A look, ten a second, finds them all changed.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.against import Row
from bench.drivers.case import NotHere
from bench.face_clients import CLIENTS, FaceClient
from bench.face_process import SETTLING, clients_of, connect, running, serving
from bench.live import folders
from bench.open_page import expect_running
from bench.realtime import take
from bench.report import Doing, Target
from umo.latency import Samples
from umo.process.start import Started

TITLE = "The faces, each with a client of another project"
COUNTS = (60, 1000)
MANY = 2000
"""Objects of one more station for OPC UA."""
BLOCK = 10.0
"""Duration in s of a measurement."""
LIMIT = 1.05
ROW_TAKES, PAIR_TAKES = 28.0, 42.0
"""Times in s, about."""
PARTS = {"waking up + execution": "total", "  waking up alone": "wake", "  execution alone": "work"}
SHOWN = [(name, share) for name in PARTS for share in (50, 99) if (PARTS[name], share) != ("wake", 50)]
"""The rows of the loop. A loop that waits busily is awake at the tick: the median of that is 0."""


def measure(pairs: int, doing: Doing) -> Iterator[Target]:
    """A row for each face and count; then so many pairs of blocks of the loop."""
    with folders(), tempfile.TemporaryDirectory() as folder, asyncio.Runner() as runner:
        missing: dict[type[FaceClient], str] = {}
        for count, client in [(count, client) for count in COUNTS for client in CLIENTS] + [(MANY, CLIENTS[1])]:
            if client in missing:
                continue
            doing(f"{client.face}, {count:,} objects")
            try:
                yield runner.run(_cost(client, count, Path(folder)))
            except NotHere as error:
                missing[client] = str(error)
                yield Target(client.face, "", "-", f"left out: {error}")
        if present := [client for client in CLIENTS if client not in missing]:
            yield from _loop(present, pairs, runner, Path(folder), doing)


def takes(pairs: int) -> float:
    """Time in s, about."""
    return ROW_TAKES * (len(COUNTS) * len(CLIENTS) + 1) + PAIR_TAKES * pairs


# Processor time and memory ------------------------------------------------------------------------------------


async def _cost(kind: type[FaceClient], count: int, folder: Path) -> Target:
    async with (
        running(count, "50 ms") as started,
        clients_of([kind], folder) as [client],
        serving([client], started) as (face, addresses),
    ):
        begun = face.processor
        alone = await face.share(BLOCK / 2)
        await connect([client], addresses, count)
        told, since = await client.told(), time.monotonic()
        share = await face.share(BLOCK)
        elapsed = time.monotonic() - since
        values, fresh = (after - before for after, before in zip(await client.told(), told, strict=True))
        expect_running(started)
        memory = face.memory
    expected = client.rate * elapsed * (count if client.takes_all else count // 2)
    late = f", {fresh:,} within 2 s" if fresh != values else ""
    cost = f"{share:.1%} of a core ({alone:.1%} without a client), {memory:.0f} MB; start {begun:.1f} s of a core"
    what = f"{client.face}, {count:,} objects ({client.project})"
    return Target(what, "-", cost, f"told {values:,} of {expected:,.0f}{late}")


# The loop -----------------------------------------------------------------------------------------------------


def _loop(
    kinds: Sequence[type[FaceClient]], pairs: int, runner: asyncio.Runner, folder: Path, doing: Doing
) -> Iterator[Target]:
    """So many blocks with all faces and as many without, in turns; which is first changes."""
    rows = {(name, share): Row(name) for name, share in SHOWN}
    sides = Samples(), Samples()
    for number in range(pairs):
        doing(f"the loop, pair {number + 1} of {pairs}")
        found = runner.run(_pair(kinds, folder, beside_first=bool(number % 2)))
        for (name, share), row in rows.items():
            with_them, without = (float(np.percentile(getattr(side, PARTS[name]), share)) for side in found)
            row.pairs.append((with_them, without))
        for whole, part in zip(sides, found, strict=True):
            whole.wake, whole.work = np.append(whole.wake, part.wake), np.append(whole.work, part.work)
            whole.missed += part.missed
    what = f"a loop of 1 ms with {', '.join(each.face for each in kinds)}"
    for title, side in zip((what, "  without them"), sides, strict=True):
        yield Target(title, "-", f"{len(side.total):,} periods", f"missed {side.missed:,}")
    for (name, share), row in rows.items():
        here, there = (float(np.median(side)) for side in zip(*row.pairs, strict=True))
        low, high = row.interval
        shown = f"{np.median(row.ratios):.3f} ({low:.3f} to {high:.3f}); {here:.1f} and {there:.1f} us"
        limited = PARTS[name] == "total"
        verdict = "" if not limited else "missed" if low > LIMIT else "met" if high <= LIMIT else "not told apart"
        yield Target(f"{name}, p{share}, to without", f"{LIMIT}" if limited else "-", shown, verdict)


async def _pair(kinds: Sequence[type[FaceClient]], folder: Path, *, beside_first: bool) -> tuple[Samples, Samples]:
    """A block with all faces and one without, of one run."""
    beside, without = Samples(), Samples()
    async with running(COUNTS[0], "1 ms") as started:
        if not beside_first:
            await _block(started, without)
        async with clients_of(kinds, folder) as clients, serving(clients, started) as (_, addresses):
            await connect(clients, addresses, COUNTS[0])
            await _block(started, beside)
        if beside_first:
            await _block(started, without)
    return beside, without


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
