"""A recorder of a fleet in this process, runs with known sequences for it, and what its files have."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import duckdb
import numpy as np

from helpers.fleets import Fleet
from umo.clients.faces.conformance import TriedMachine
from umo.clients.fleet.fleet_query import asked
from umo.clients.fleet.fleet_record import FleetRecorder
from umo.clients.fleet.fleet_record_files import RecordFolder
from umo.clients.fleet.fleet_record_source import FleetSource, RecordSource
from umo.clients.fleet.message_parts import packed
from umo.clients.fleet.run_words import FULL, LAST, Delta, RunMetadata, WordFrame
from umo.process.frames.layout import Layout

if TYPE_CHECKING:
    from umo.clients.fleet.jetstream_server import JetStreamServer

OBJECTS = (
    {"path": "level", "kind": "DigitalSensor", "unit": "mm", "minimum": 0.0, "maximum": 9.0},
    {"path": "limit", "kind": "BinarySensor", "one": "FAIL", "zero": "PASS"},
    {"path": "still", "kind": "DigitalSensor", "unit": "V", "minimum": 0.0, "maximum": 1.0},
)
UTC = 1_764_000_000_000_000_000
"""ns: of period 0 of a known run."""


class KnownRun:
    """A run whose delta n has the level n / 10, the limit FAIL at odd numbers, each 0.1 s."""

    def __init__(self, run: bytes = b"known run"[:8], full_every: int = 10) -> None:
        self.run, self.name, self._full_every = run, run.hex(), full_every
        about = {"station": "plant", "wiring": "simulated", "pid": 1, "started": 1e9, "period": 0.1}
        self.layout = Layout(OBJECTS, ("read",), about, tunables=({"path": "gain", "unit": "mm"},))
        self._words = WordFrame(self.layout)
        self.rest = RunMetadata(1, -1, 0, 0, b"", np.array([2.5]).tobytes()).packed()

    def words(self, number: int) -> Any:
        frame = np.zeros(1, self._words.dtype)
        frame["number"], frame["time"] = number, number * 0.1
        frame["began"], frame["utc"], frame["utc_error"] = number * 100_000_000, UTC, 5000
        frame["values"][0] = number / 10, number % 2, np.nan
        frame["quality"][0] = 0, 0, 4
        return self._words.words(frame[0])

    def delta(self, number: int, *, is_last: bool = False) -> bytes:
        flags = (FULL if number % self._full_every == 0 else 0) | (LAST if is_last else 0)
        before = None if flags & FULL else self.words(number - 1)
        places, words = self._words.changed(self.words(number), before)
        return Delta(self.run, number, flags, places, words, self.rest if flags else b"").packed()

    def declaration(self, number: int) -> bytes:
        about = {"run": self.name, "number": number, "stride": 1, "site": "cell7", "event": 0}
        words = self.words(number).tobytes() if number >= 0 else b""
        return packed(json.dumps(about).encode(), self.layout.describe(), words, self.rest)

    def events(self, *numbers: int) -> dict[str, Any]:
        told = [[number, number * 0.1, "level", f"event {number}", "ann", 0, 0, ""] for number in numbers]
        return {"run": self.name, "events": told}


def rows(root: Path, sql: str) -> list[Any]:
    """The answer to a question about a history."""
    with asked(root, sql) as answer:
        return list(answer.fetchall())


def by_duckdb(sql: str) -> list[Any]:
    """DuckDB alone."""
    with duckdb.connect() as connection:
        return list(connection.execute(sql).fetchall())


async def until_recorded(condition: Callable[[], Any], within: float = 120.0) -> Any:
    """What a condition about files returns, once it is true: asked beside the loop, in which the machine runs."""
    async with asyncio.timeout(within):
        while not (found := await asyncio.to_thread(condition)):
            await asyncio.sleep(0.1)
    return found


class Recording:
    """A recorder in a thread, which can be killed."""

    def __init__(self, fleet: Fleet, root: Path, jetstream: JetStreamServer | None = None) -> None:
        self._fleet, self.root, self._jetstream = fleet, root, jetstream
        self.said: list[str] = []
        self._stop: threading.Event | None = None

    async def begin(self) -> None:
        self.folder: Any = RecordFolder(self.root, self.said.append)
        self._from: Any = await self._source()
        recorder = FleetRecorder(self._from, self.folder, say=self.said.append)
        self._stop = stop = threading.Event()
        self._thread = threading.Thread(target=recorder.run, args=(stop.is_set,), daemon=True)
        self._thread.start()

    async def _source(self) -> RecordSource:
        if self._jetstream is not None:
            from umo.clients.fleet.jetstream_source import JetStreamSource

            made = JetStreamSource(self._jetstream, self.folder, ["*/*"], self.said.append)
            self._close = made.close
            return made
        session = await self._fleet.session()
        self._close = session.close
        return FleetSource(session)

    async def end(self, *, killed: bool = False) -> None:
        """`killed`: what has not been written is lost."""
        if self._stop is None:
            return
        if killed:
            self.folder.write = self.folder.write_objects = self._from.written = lambda *given: None
        self._stop.set()
        await asyncio.to_thread(self._thread.join)
        await asyncio.to_thread(self._close)
        self.folder.close()
        self._stop = None

    def deltas(self) -> list[int]:
        """The numbers of the deltas in the files, in the order of time."""
        if not self.root.is_dir() or not list(self.root.glob("values/*/*/*.parquet")):
            return []
        return [row[0] for row in rows(self.root, "SELECT delta FROM values WHERE path = 'cell.level' ORDER BY number")]


@asynccontextmanager
async def recording(fleet: Fleet, root: Path) -> AsyncIterator[Recording]:
    made = Recording(fleet, root)
    await made.begin()
    try:
        yield made
    finally:
        await made.end()


class Truth:
    """What the machine had, from its own ring; its level goes up and down meanwhile."""

    def __init__(self, machine: TriedMachine) -> None:
        self._machine, self.levels = machine, dict[int, float]()
        self._task = asyncio.create_task(self._follow())

    async def _follow(self) -> None:
        raw = 0
        with self._machine.find() as reader:
            place = reader.index("cell.level")
            while True:
                raw = (raw + 7) % 200
                self._machine.set("cell.level", raw)
                frames = reader.read()
                levels = frames["values"][:, place].tolist()
                self.levels.update(zip(frames["number"].tolist(), levels, strict=True))
                assert not reader.lost
                await asyncio.sleep(0.02)

    async def end(self) -> None:
        self._task.cancel()
        with suppress(asyncio.CancelledError):
            await self._task


def recorded_levels(root: Path) -> dict[int, float]:
    found = rows(root, "SELECT number, value FROM values WHERE path = 'cell.level' ORDER BY number")
    assert len(found) == len(dict(found)), "a period is there twice"
    return dict(found)


def check(root: Path, truth: Truth) -> None:
    """The files have every delta's period, once, with the machine's value; no gap."""
    levels = recorded_levels(root)
    assert len(levels) > 20
    gaps = rows(root, "SELECT of, first, last, why FROM gaps WHERE why <> 'before it was recorded'")
    assert gaps == []
    assert {after - before for before, after in pairwise(levels)} == {20}
    assert levels == {number: truth.levels[number] for number in levels}
    assert len(set(levels.values())) > 5
