"""The history of a fleet: what is in its files is what the machines had."""

from __future__ import annotations

import asyncio
import sys
import threading
from collections.abc import Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")
duckdb = pytest.importorskip("duckdb", reason="the extra fleet-history is not installed")
pq = pytest.importorskip("pyarrow.parquet", reason="the extra fleet-history is not installed")

from helpers.fleets import PLANT, Fleet, fleet_of
from umo.fleet import fleet_record
from umo.fleet.fleet_record import FleetRecorder
from umo.fleet.fleet_record_files import RecordFolder
from umo.testing.faces import TriedMachine
from umo.testing.faces.tried_machine import until

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("UMO_FRAMES", "UMO_STATE", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setattr(fleet_record, "FLUSH", 0.2)


class Recording:
    """A recorder in a thread."""

    def __init__(self, fleet: Fleet, root: Path, **more: Any) -> None:
        self._fleet, self.root, self._more = fleet, root, more
        self.said: list[str] = []

    async def begin(self) -> None:
        self._session = await self._fleet.session()
        self._folder = RecordFolder(self.root, self.said.append)
        self.recorder = FleetRecorder(self._session, self._folder, say=self.said.append, **self._more)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.recorder.run, args=(self._stop.is_set,))
        self._thread.start()

    async def end(self, *, killed: bool = False) -> None:
        """`killed`: what it has not written is lost."""
        if killed:
            self.recorder._write = lambda followed: None  # type: ignore[method-assign]
        self._stop.set()
        await asyncio.to_thread(self._thread.join)
        await asyncio.to_thread(self._session.close)
        self._folder.close()

    def ask(self, sql: str) -> list[Any]:
        """DuckDB alone, over the files."""
        with duckdb.connect() as connection:
            return list(connection.sql(sql.replace("FOLDER", str(self.root))).fetchall())

    def deltas(self) -> list[int]:
        if not list(self.root.glob("values/*/*/*.parquet")):
            return []
        return [row[0] for row in self.ask(f"SELECT delta FROM {VALUES} WHERE path = 'cell.gain' OR path = 'tunable:cell.gain' ORDER BY delta")]


VALUES = "read_parquet('FOLDER/values/*/*/*.parquet', hive_partitioning = true)"
EVENTS = "read_parquet('FOLDER/events/*/*/*.parquet', hive_partitioning = true)"
GAPS = "read_parquet('FOLDER/gaps/*/*/*.parquet', hive_partitioning = true)"


@asynccontextmanager
async def recording(fleet: Fleet, root: Path, **more: Any) -> Any:
    made = Recording(fleet, root, **more)
    await made.begin()
    try:
        yield made
    finally:
        await made.end()


def tried(work: Callable[[TriedMachine, Fleet], Awaitable[None]], **more: Any) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine, fleet_of(machine, **more) as fleet:
            await work(machine, fleet)

    asyncio.run(all_of_it())


def test_values_states_qualities_and_events_are_in_files_that_others_read(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        machine.set("cell.level", 41)
        machine.set("cell.limit", 1)
        async with recording(fleet, tmp_path / "history") as history:
            await until(lambda: len(history.deltas()) > 10)
        rows = history.ask(f"SELECT path, value, state, quality, site, station FROM {VALUES} ORDER BY delta DESC LIMIT 40")
        last = {row[0]: row[1:] for row in reversed(rows)}
        assert last["cell.level"] == (20.5, None, "GOOD", "cell7", "plant")
        assert last["cell.limit"] == (1.0, "FAIL", "GOOD", "cell7", "plant")
        print(last, history.said, history.deltas(), history.ask(f"SELECT * FROM {GAPS}"))
        print(history.ask(f"SELECT * FROM {EVENTS}"))

    tried(work)
