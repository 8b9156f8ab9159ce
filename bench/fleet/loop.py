"""`python -m bench --fleet-loop PAIRS`: a loop of 1 ms whose station is in a fleet, to one without."""

from __future__ import annotations

import asyncio
import os
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from bench.beside import compared
from bench.face_process import STARTING
from bench.fleet.parts import UMO, Part
from bench.live import folders
from bench.report import Doing, Target
from umo.process.start import Started

TITLE = "A loop of 1 ms in a fleet: router, gateway and recorder on its computer, to without"
ADDRESS = "tcp/127.0.0.1:17450"
PAIR_TAKES = 42.0
"""s, about."""


def measure(pairs: int, doing: Doing) -> Iterator[Target]:
    with folders(), tempfile.TemporaryDirectory() as folder, asyncio.Runner() as runner:
        yield from compared(partial(_beside, Path(folder)), "a fleet", pairs, runner, doing)


@asynccontextmanager
async def _beside(folder: Path, started: Started) -> AsyncIterator[None]:
    words = {
        "router": ("connect", "router", "--listen", ADDRESS),
        "gateway": ("connect", "fleet", "--site", "cell7", "--connect", ADDRESS),
        "recorder": ("recording", "history", str(folder / "history"), "--connect", ADDRESS),
    }
    parts = [Part(name, (*UMO, *more), folder, os.environ) for name, more in words.items()]
    try:
        for part in parts:
            part.start()
            await asyncio.sleep(STARTING / len(parts))
        await asyncio.sleep(STARTING)
        if dead := [each for each in parts if not each.is_running]:
            raise RuntimeError(f"{dead[0].name} has ended: {dead[0].said}")
        yield
    finally:
        for part in parts:
            part.kill()
