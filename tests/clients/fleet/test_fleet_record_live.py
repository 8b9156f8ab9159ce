"""A recorder of a fleet that runs: what is in its files is what the machine had, whoever is killed."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")
pytest.importorskip("duckdb", reason="the extra fleet-history is not installed")
pytest.importorskip("pyarrow", reason="the extra fleet-history is not installed")

from helpers.fleet_histories import Recording, Truth, by_duckdb, check, recorded_levels, recording, rows, until_recorded
from helpers.fleets import PLANT, Fleet, fleet_of
from umo.clients.faces.conformance import TriedMachine
from umo.clients.fleet import fleet_record
from umo.testing.periods import periods

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a fleet needs Linux"),
]


@pytest.fixture(autouse=True)
def short_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_record, "FLUSH", 0.1)


def tried(work: Callable[[TriedMachine, Fleet], Awaitable[None]], **more: Any) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine, fleet_of(machine, **more) as fleet:
            await work(machine, fleet)

    asyncio.run(all_of_it())


def test_values_states_qualities_and_events_are_in_files_that_others_read(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        machine.set("cell.limit", 1)
        truth = Truth(machine)
        async with recording(fleet, tmp_path / "history") as history:
            await until_recorded(lambda: len(history.deltas()) > 20)
            machine.set("cell.level", OSError("unplugged"))
            await truth.end()
            number = machine.number
            await until_recorded(lambda: history.deltas() and max(recorded_levels(history.root)) > number + 40)
        check_qualities(history.root)
        levels = recorded_levels(history.root)
        assert all(levels[each] == truth.levels[each] for each in levels if each in truth.levels)
        told = rows(history.root, "SELECT path, text, site, station FROM events ORDER BY number")
        assert told == [(each.path, each.text, "cell7", "plant") for each in machine.events]

    tried(work)


def check_qualities(root: Path) -> None:
    files = f"read_parquet('{root}/values/*/*/*.parquet', hive_partitioning = true)"
    last = by_duckdb(f"SELECT path, value, state, quality, site, station FROM {files} ORDER BY delta DESC LIMIT 30")
    told = {path: more for path, *more in reversed(last)}
    assert told["cell.limit"] == [1.0, "FAIL", "GOOD", *PLANT]
    assert told["cell.level"][2] == "STALE"
    assert told["tunable:cell.gain"][0] == 1.0
    assert told["cell.phase"][1] == "idle"


def test_a_recorder_that_is_killed_loses_nothing_that_the_gateway_still_has(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        truth = Truth(machine)
        history = Recording(fleet, tmp_path / "history")
        for _ in range(4):
            before = len(history.deltas())
            await history.begin()
            await until_recorded(lambda before=before: len(history.deltas()) > before + 20)  # type: ignore[misc]
            await history.end(killed=True)
            await asyncio.sleep(0.5)
        await history.begin()
        number = machine.number
        await until_recorded(lambda: max(recorded_levels(history.root)) > number)
        await history.end()
        await truth.end()
        check(history.root, truth)

    tried(work)


def test_a_gateway_that_begins_again_is_recorded_on(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        truth = Truth(machine)
        async with recording(fleet, tmp_path / "history") as history:
            for _ in range(3):
                before = len(history.deltas())
                await until_recorded(lambda before=before: len(history.deltas()) > before + 20)  # type: ignore[misc]
                await fleet.end()
                await asyncio.sleep(0.3)
                await fleet.begin()
            number = machine.number
            await until_recorded(lambda: max(recorded_levels(history.root)) > number)
        await truth.end()
        check(history.root, truth)

    tried(work)


def test_what_the_gateway_no_longer_has_is_a_gap_with_its_count(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        history = Recording(fleet, tmp_path / "history")
        await history.begin()
        await until_recorded(lambda: len(history.deltas()) > 20)
        await history.end()
        last = history.deltas()[-1]
        await fleet.end()
        with machine.find() as reader:
            for _ in range(reader.slots + 200):  # more than its ring holds
                periods(machine.m)
        await fleet.begin()
        await history.begin()
        await until_recorded(lambda: history.deltas()[-1] > last)
        await history.end()
        told = rows(history.root, "SELECT first, last, count, why FROM gaps WHERE why <> 'before it was recorded'")
        ((first, end, count, why),) = told
        assert (first, why) == (last + 1, "the recorder was away")
        deltas = history.deltas()
        assert set(range(first, end + 1)) | set(deltas) == set(range(deltas[-1] + 1))
        assert count == end - first + 1 > 0

    tried(work)


def test_runs_that_end_and_begin_again_are_recorded_to_their_last_period(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        async with recording(fleet, tmp_path / "history") as history:
            for run in (1, 2):
                await until_recorded(lambda run=run: len(history.deltas()) > 15 * run)  # type: ignore[misc]
                await machine.end()
                asked = f"SELECT count(*) FROM events WHERE asked = 'end' HAVING count(*) = {run}"
                await until_recorded(lambda asked=asked: rows(history.root, asked))  # type: ignore[misc]
                if run == 1:
                    machine.begin()
        runs = rows(history.root, "SELECT run, count(DISTINCT delta), max(delta) FROM values GROUP BY run")
        assert len(runs) == 2
        assert rows(history.root, "SELECT * FROM gaps") == []

    tried(work)


def test_the_command_records_over_kill_9_and_ends_with_whole_files(tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        truth = Truth(machine)
        root = tmp_path / "history"
        code = "from umo_command import main; main()"
        words = ["-c", code, "recording", "history", str(root), "--connect", fleet.address]

        def last() -> int:
            return max(recorded_levels(root), default=0) if (root / "values").is_dir() else 0

        for number in (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM):
            before = machine.number
            recorder = await asyncio.create_subprocess_exec(sys.executable, *words, env=dict(os.environ))
            await until_recorded(lambda before=before: last() > before + 100)  # type: ignore[misc]
            recorder.send_signal(number)
            status = await recorder.wait()
        assert status == 0
        await truth.end()
        check(root, truth)

    tried(work)
