"""What a recording costs: processor time and bytes of the recorder beside 13, 1,000 and 10,000 objects; and a loop of
1 ms with the recorder, to without, in turns.

The 13 objects are those of z-theta at work. Of the others half have new values in every period.
"""

from __future__ import annotations

import asyncio
import os
import signal
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from functools import partial
from pathlib import Path

from bench.beside import compared
from bench.face_process import FaceProcess, running
from bench.live import folders
from bench.open_page import expect_running
from bench.report import Doing, Target, upper
from umo.process.job import Job
from umo.process.start import Started
from umo.recording.block import exact_message
from umo.recording.mcap_writer import LEVEL
from umo.recording.record_settings import record_of
from umo.recording.recording import Recording
from umo_command.run.record_beside import RecordBeside, RecordOrder

TITLE = "A recording"
BLOCK, SETTLING = 10.0, 1.0
"""Times in s of a measurement, and before it."""
ROW_TAKES, PAIR_TAKES = 20.0, 28.0
MINUTE = 60.0
SHARES = {13: 1.5, 1000: 10.0, 10_000: 10.0}
"""Limits: % of a core."""
MEGABYTES, NEEDED = 3.0, 0.5
"""Limits for 13 objects at 1 kHz, MB a minute: the whole file, and what replay needs."""


def measure(pairs: int, doing: Doing) -> Iterator[Target]:
    """A row or two for each size; then so many pairs of blocks of the loop."""
    with folders(), tempfile.TemporaryDirectory() as folder, asyncio.Runner() as runner:
        for count, period in ((13, "1 ms"), (1000, "1 ms"), (10_000, "10 ms")):
            doing(f"{count:,} objects")
            yield from runner.run(_cost(count, period, Path(folder) / f"{count}.mcap"))
        if pairs:
            yield from compared(partial(_beside, Path(folder)), "the recorder", pairs, runner, doing)


def takes(pairs: int) -> float:
    """Time in s, about."""
    return 3 * ROW_TAKES + PAIR_TAKES * pairs


@asynccontextmanager
async def _manipulator() -> AsyncIterator[Started]:
    with Started(Job(station="ztheta", options={"realtime": True, "parts": 6})) as started:
        while started.frames is None:
            await asyncio.sleep(0.02)
            expect_running(started)
        yield started


def _station(count: int, period: str) -> AbstractAsyncContextManager[Started]:
    return _manipulator() if count == 13 else running(count, period)


async def _cost(count: int, period: str, file: Path) -> list[Target]:
    async with _station(count, period) as started:
        with _recorder(file, started) as process:
            await asyncio.sleep(SETTLING)
            share = await process.share(BLOCK)
            memory = process.memory
            expect_running(started)
    with Recording(file) as recording:
        frames = sum(len(block.frames) for block in recording.blocks(full=False))
        lost = sum(gap.count for gap in recording.gaps)
        needed = _needed(recording)
    length = frames * float(recording.about["period"])
    whole = file.stat().st_size / 1e6 * MINUTE / length
    what = f"{count:,} objects, {period}"
    rows = [upper(f"{what}: processor", 100 * share, SHARES[count], "%", 100 * share)]
    rows.append(Target("  memory, periods", "-", f"{memory:.0f} MB", f"{frames:,}, lost {lost:,}"))
    if count == 13:
        rows.append(upper("  MB a minute", whole, MEGABYTES, "", whole))
        rows.append(upper("  MB a minute that replay needs", needed / length * MINUTE, NEEDED, "", needed / length))
    else:
        rows.append(
            Target("  MB a minute, and what replay needs", "-", f"{whole:.1f}, {needed / length * MINUTE:.2f}", "")
        )
    return rows


def _needed(recording: Recording) -> float:
    """MB of what replay needs."""
    import zstandard

    compressor = zstandard.ZstdCompressor(level=LEVEL)
    return sum(len(compressor.compress(exact_message(block))) for block in recording.blocks(full=False)) / 1e6


class _recorder:
    """The recorder of a run, while the block lasts."""

    def __init__(self, file: Path, started: Started) -> None:
        self._beside = RecordBeside(RecordOrder(file, record_of({}).plain))
        self._started = started

    def __enter__(self) -> FaceProcess:
        self._beside.__enter__()
        assert self._started.frames is not None and self._beside._process is not None
        self._beside.attach(self._started.frames)
        return FaceProcess(self._beside._process.pid)

    def __exit__(self, *error: object) -> None:
        if self._beside._process is not None:
            with suppress(OSError):
                os.kill(self._beside._process.pid, signal.SIGTERM)
        self._beside.__exit__(None, None, None)


# The loop -----------------------------------------------------------------------------------------------------


@asynccontextmanager
async def _beside(folder: Path, started: Started) -> AsyncIterator[None]:
    """The recorder of a run; its file goes with it."""
    file = folder / "loop.mcap"
    with _recorder(file, started):
        yield
    file.unlink()
