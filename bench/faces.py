"""What the faces cost: processor time and memory of each beside a station of 60 and of 1,000 objects, with a client of
another project that takes everything; and a loop of 1 ms with all of them and their clients, to without, in turns.

Half of the objects change in every period. A look, ten a second, finds them all changed.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from bench.beside import compared
from bench.drivers.case import NotHere
from bench.face_clients import CLIENTS, FaceClient
from bench.face_process import clients_of, connect, running, serving
from bench.live import folders
from bench.open_page import expect_running
from bench.report import Doing, Target
from umo.process.start import Started

TITLE = "The faces, each with a client of another project"
COUNTS = (60, 1000)
MANY = 2000
"""Objects of one more station for OPC UA."""
BLOCK = 10.0
"""Duration in s of a measurement."""
ROW_TAKES, PAIR_TAKES = 28.0, 42.0
"""Times in s, about."""


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
            what = ", ".join(each.face for each in present)
            yield from compared(partial(_beside, present, Path(folder)), what, pairs, runner, doing)


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


@asynccontextmanager
async def _beside(kinds: Sequence[type[FaceClient]], folder: Path, started: Started) -> AsyncIterator[None]:
    """All faces of a station with their clients."""
    async with clients_of(kinds, folder) as clients, serving(clients, started) as (_, addresses):
        await connect(clients, addresses, COUNTS[0])
        yield
