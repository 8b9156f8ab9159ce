"""Gateways that publish to a JetStream, and a recorder that reads it: what is in the files is what the machine had."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")
pytest.importorskip("nats", reason="the extra fleet-jetstream is not installed")
pytest.importorskip("duckdb", reason="the extra fleet-history is not installed")
pytest.importorskip("pyarrow", reason="the extra fleet-history is not installed")

from helpers.fleet_histories import Recording, Truth, check, recorded_levels, rows, until_recorded
from helpers.fleets import PLANT, Fleet, Sent, free_port
from helpers.jetstreams import NatsServer, needs_server, server
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.fleet import fleet_record, jetstream_publisher, jetstream_server, station_publisher
from umo.clients.fleet.fleet_record import FleetRecorder, Incoming
from umo.clients.fleet.fleet_record_files import RecordFolder
from umo.clients.fleet.jetstream_publisher import JetStreamPublisher
from umo.clients.fleet.jetstream_server import STREAM, JetStreamServer
from umo.clients.fleet.jetstream_source import JetStreamSource
from umo.clients.fleet.station_publisher import StationPublisher
from umo.process.frames.frame_server import sockets
from umo.process.frames.search import frames_at

__all__ = ["server"]
pytestmark = [
    needs_server,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a fleet needs Linux"),
]


@pytest.fixture(autouse=True)
def short_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_record, "FLUSH", 0.1)
    monkeypatch.setattr(jetstream_publisher, "PAUSE", 0.02)
    monkeypatch.setattr(jetstream_server, "RETRY_DELAY", 0.1)


class StreamedFleet(Fleet):
    """A gateway that publishes to a JetStream, too."""

    def __init__(self, machine: TriedMachine, stream: JetStreamServer) -> None:
        super().__init__(machine, free_port())
        self.stream = stream
        self.history: JetStreamPublisher | None = None

    async def serve(self, session: Any, users: Any, **more: Any) -> None:
        self.history = JetStreamPublisher(self.stream, self.said.append)
        await super().serve(session, users, history=self.history, **more)

    async def end(self) -> None:
        await super().end()
        if self.history is not None:
            await asyncio.to_thread(self.history.close)
            self.history = None

    async def kill(self) -> None:
        """End the gateway so that nothing more of it gets into the stream."""
        history, self.history = self.history, None
        if history is not None:
            history._cursors = []
            history.end = history.begin = lambda publisher: None  # type: ignore[method-assign]
        await super().end()
        if history is not None:
            await asyncio.to_thread(history.close)


def tried(server: NatsServer, work: Callable[[TriedMachine, StreamedFleet], Awaitable[None]], **limits: Any) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine:
            fleet = StreamedFleet(machine, JetStreamServer(server.url, **limits))
            await fleet.begin()
            try:
                await work(machine, fleet)
            finally:
                await fleet.close()

    asyncio.run(all_of_it())


async def state(stream: JetStreamServer) -> Any:
    async with stream.connected() as (_, js):
        return (await js.stream_info(STREAM)).state


def arrivals(patch: pytest.MonkeyPatch) -> list[str]:
    """The kinds of the messages that come to a recorder from now on."""
    come, put = list[str](), Incoming.put

    def noted(incoming: Incoming, kind: str, *message: Any) -> None:
        put(incoming, kind, *message)
        come.append(kind)

    patch.setattr(Incoming, "put", noted)
    return come


async def until_streamed(stream: JetStreamServer, count: int) -> None:
    async with asyncio.timeout(40.0):
        while (await state(stream)).last_seq < count:
            await asyncio.sleep(0.1)


async def recorded_up_to(history: Recording, number: int) -> None:
    await until_recorded(lambda: max(recorded_levels(history.root) if history.deltas() else [0]) > number)


async def ends_whole(history: Recording, truth: Truth, number: int) -> None:
    """Once this period is recorded, the recorder ends: the files have what the machine had."""
    await recorded_up_to(history, number)
    await history.end()
    await truth.end()
    check(history.root, truth)


# What is recorded ------------------------------------------------------------------------------------------


@pytest.mark.skipif(find_spec("bench") is None, reason="not in a clone")
def test_what_a_gateway_has_published_is_recorded_from_the_stream(
    server: NatsServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bench.fleet.rings import MadeRing, value

    stream, objects, count = JetStreamServer(server.url), 3, 250
    ring = MadeRing("made", objects)
    this = StationPublisher(Sent(), PLANT, frames_at(sockets()[0]), 0.1)  # type: ignore[arg-type]
    said, come = list[str](), arrivals(monkeypatch)
    history = JetStreamPublisher(stream, said.append)
    history.begin(this)
    for _ in range(count):
        ring.step()
        this.look()
    history.close()  # sends the rest
    files = RecordFolder(tmp_path / "history", said.append)
    with closing(JetStreamSource(stream, files, ["cell7/*"], said.append)) as source:
        recorder = FleetRecorder(source, files, say=said.append)
        recorder.run(lambda: "declaration" in come and len(come) > count)
    files.close()
    found = rows(files.root, "SELECT delta, value FROM values WHERE path = 'cell.o001' ORDER BY number")
    assert [each[0] for each in found] == list(range(count))
    assert [each[1] for each in found] == [value(number, objects)[1] for number in range(count)]
    assert rows(files.root, "SELECT * FROM gaps") == []
    this.end()
    this.close()
    ring.close()


@pytest.mark.full
def test_a_recorder_that_begins_later_has_what_the_stream_holds(server: NatsServer, tmp_path: Path) -> None:
    """Longer than the gateway keeps: it keeps none."""

    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        truth = Truth(machine)
        await until_streamed(fleet.stream, 60)
        await fleet.end()  # nobody can be asked
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        await history.begin()
        await until_recorded(lambda: len(history.deltas()) > 40)
        await history.end()
        await truth.end()
        check(history.root, truth)
        told = rows(history.root, "SELECT path, text FROM events ORDER BY number")
        assert told == [(each.path, each.text) for each in machine.events][: len(told)]
        assert told

    tried(server, work)


@pytest.mark.full
def test_a_recorder_that_is_killed_again_and_again_reads_on(server: NatsServer, tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        truth = Truth(machine)
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        for turn in range(5):
            before = machine.number
            await history.begin()
            await recorded_up_to(history, before)
            await history.end(killed=turn % 2 == 0)
            await asyncio.sleep(0.5)
        number = machine.number
        await history.begin()
        await ends_whole(history, truth, number)

    tried(server, work)


@pytest.mark.full
def test_a_server_that_is_killed_loses_nothing_that_the_gateway_keeps(server: NatsServer, tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        truth = Truth(machine)
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        await history.begin()
        for _ in range(3):
            number = machine.number
            await recorded_up_to(history, number + 100)
            await server.killed()
            looked = machine.number
            await until(lambda: any("is away" in each for each in fleet.said))
            await until(lambda looked=looked: machine.number > looked + 200)  # type: ignore[misc]
            await server.begun()
            fleet.said.clear()
        number = machine.number
        await ends_whole(history, truth, number)
        assert "the JetStream can be reached again" in history.said

    tried(server, work)


@pytest.mark.full
def test_what_is_not_kept_any_more_when_the_server_is_back_is_a_gap_and_told(
    server: NatsServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(station_publisher, "MAX_DELTAS", 10)
    monkeypatch.setattr(station_publisher, "KEPT", 0.5)
    monkeypatch.setattr(station_publisher, "FULL_EVERY", 10)

    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        await history.begin()
        await until_recorded(lambda: len(history.deltas()) > 20)
        await server.killed()
        number = machine.number
        await until(lambda: machine.number > number + 2000)
        await server.begun()
        number = machine.number
        await recorded_up_to(history, number)
        await history.end()
        ((first, last, count),) = rows(
            history.root, "SELECT first, last, count FROM gaps WHERE of = 'values' AND why = 'they did not arrive'"
        )
        assert count == last - first + 1 > 20
        deltas = history.deltas()
        assert sorted([*deltas, *range(first, last + 1)]) == list(range(deltas[-1] + 1))
        assert [each for each in fleet.said if each.startswith(f"{PLANT}: {count} deltas and 0 events were not stored")]

    tried(server, work)


@pytest.mark.full
def test_a_gateway_that_is_killed_begins_again_with_what_the_ring_holds(server: NatsServer, tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        truth = Truth(machine)
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        await history.begin()
        for _ in range(3):
            number = machine.number
            await recorded_up_to(history, number + 100)
            await fleet.kill()
            await asyncio.sleep(0.3)
            await fleet.begin()
        number = machine.number
        await ends_whole(history, truth, number)

    tried(server, work)


@pytest.mark.full
def test_a_message_that_comes_twice_is_in_the_stream_once_and_in_the_files_once(
    server: NatsServer, tmp_path: Path
) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        truth = Truth(machine)
        await until_streamed(fleet.stream, 40)
        async with fleet.stream.connected() as (_, js):
            found = await js.get_msg(STREAM, 30)
            again = await js.publish(str(found.subject), found.data or b"", headers=found.headers)
            assert again.duplicate
            for each in range(20, 30):  # as if the time of the server for duplicates were over
                found = await js.get_msg(STREAM, each)
                headers = {key: value for key, value in (found.headers or {}).items() if key != "Nats-Msg-Id"}
                assert not (await js.publish(str(found.subject), found.data or b"", headers=headers)).duplicate
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        number = machine.number
        await history.begin()
        await ends_whole(history, truth, number)

    tried(server, work)


@pytest.mark.full
def test_what_a_full_stream_has_dropped_is_a_gap_with_its_count(server: NatsServer, tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        await history.begin()
        await until_recorded(lambda: len(history.deltas()) > 20)
        await history.end()
        last = history.deltas()[-1]
        async with asyncio.timeout(60.0):
            while (await state(fleet.stream)).first_seq < last + 50:
                await asyncio.sleep(0.2)
        number = machine.number
        await history.begin()
        await recorded_up_to(history, number + 100)
        await history.end()
        ((first, end, count, why),) = rows(
            history.root, "SELECT first, last, count, why FROM gaps WHERE of = 'values' AND why LIKE '%away%'"
        )
        assert (first, why) == (last + 1, "the recorder was away")
        deltas = history.deltas()
        assert sorted([*deltas, *range(first, end + 1)]) == list(range(deltas[-1] + 1))
        assert count == end - first + 1 > 0

    tried(server, work, bytes=25_000)


@pytest.mark.full
def test_a_full_disk_loses_nothing_that_the_stream_holds(
    server: NatsServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        truth = Truth(machine)
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        come = arrivals(monkeypatch)
        await history.begin()
        await until_recorded(lambda: len(history.deltas()) > 20)
        write = history.folder.write

        def full(*_: Any) -> None:
            raise OSError(28, "No space left on device")

        history.folder.write = full
        number = machine.number
        await until(lambda: machine.number > number + 1000)
        before = len(come)
        number = machine.number
        await until(lambda: machine.number > number + 500)
        assert len(come) == before  # it waits
        history.folder.write = write
        number = machine.number
        await ends_whole(history, truth, number)

    tried(server, work)


@pytest.mark.full
def test_runs_that_end_are_recorded_to_their_last_period(server: NatsServer, tmp_path: Path) -> None:
    async def work(machine: TriedMachine, fleet: StreamedFleet) -> None:
        history = Recording(fleet, tmp_path / "history", fleet.stream)
        await history.begin()
        for run in (1, 2):
            await until_recorded(lambda run=run: len(history.deltas()) > 15 * run)  # type: ignore[misc]
            await machine.end()
            asked = f"SELECT count(*) FROM events WHERE asked = 'end' HAVING count(*) = {run}"
            await until_recorded(lambda asked=asked: rows(history.root, asked))  # type: ignore[misc]
            if run == 1:
                machine.begin()
        await history.end()
        runs = rows(history.root, "SELECT run, count(DISTINCT delta), max(delta) FROM values GROUP BY run")
        assert len(runs) == 2
        assert rows(history.root, "SELECT * FROM gaps") == []
        async with fleet.stream.connected() as (_, js):  # all of it is confirmed
            (consumer,) = await js.consumers_info(STREAM)
            assert consumer.ack_floor.stream_seq == (await js.stream_info(STREAM)).state.last_seq

    tried(server, work)


@pytest.mark.full
def test_the_commands_stream_and_record_over_kill_9(server: NatsServer, tmp_path: Path) -> None:
    root = tmp_path / "history"
    program = ["-c", "from umo_command import main; main()"]
    serve = [
        *program,
        "connect",
        "fleet",
        "--rate",
        "50",
        "--site",
        "cell7",
        "--listen",
        f"tcp/127.0.0.1:{free_port()}",
    ]
    streamed = ["--jetstream", server.url]

    async def begun(*words: str) -> asyncio.subprocess.Process:
        return await asyncio.create_subprocess_exec(sys.executable, *words, env=dict(os.environ))

    def last() -> int:
        return max(recorded_levels(root), default=0) if (root / "values").is_dir() else 0

    async def work() -> None:
        async with TriedMachine() as machine:
            truth = Truth(machine)
            gateway = await begun(*serve, *streamed)
            for number in (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM):
                before = machine.number
                recorder = await begun(*program, "recording", "history", str(root), *streamed)
                await until_recorded(lambda before=before: last() > before + 100)  # type: ignore[misc]
                recorder.send_signal(number)
                status = await recorder.wait()
                if number == signal.SIGKILL:
                    gateway.kill()
                    await gateway.wait()
                    gateway = await begun(*serve, *streamed)
            gateway.send_signal(signal.SIGTERM)
            assert (status, await gateway.wait()) == (0, 0)
            await truth.end()
            check(root, truth)

    asyncio.run(work())
