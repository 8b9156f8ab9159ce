"""Commands from another process: the queue, and `umo.attach`."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from math import nan
from pathlib import Path
from random import Random
from typing import Any

import pytest

import umo
from helpers.patient import conveyor
from helpers.publishing import running
from helpers.waiting import until
from umo.clients.remote import RemoteStation
from umo.errors import CommandRefused, FramesError, RangeError
from umo.operation.commands.client_commands import DEAD_MAN_TIME, Mode
from umo.operation.commands.client_control import COMMANDS_PER_PERIOD, ClientControl
from umo.process.frames import Reader
from umo.process.frames.client_memory import HEAD, QUEUE, SLOT, SLOTS, STOP, STOP_MARK, ClientMemory
from umo.process.frames.command_queue import MAX_COMMAND_BYTES, Receiver, Sender
from umo.process.start import LINUX
from umo.testing import periods

pytestmark = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")


# The queue ----------------------------------------------------------------------------------------------


@dataclass
class Queue:
    """Both ends of the cells of a bench."""

    receiver: Receiver
    sender: Sender
    cells: ClientMemory
    reader: Any


class Machine(Reader):
    """A reader of a machine that has taken as many commands as the receiver says."""

    receiver: Receiver

    @property
    def taken(self) -> int:
        return self.receiver.taken


@pytest.fixture
def queue() -> Iterator[Queue]:
    with running() as (_, ring, _connection), Machine(ring.path) as reader:
        assert reader.ends is not None
        cells, theirs = (ClientMemory(reader.ends.cells, reader.layout) for _ in range(2))
        reader.receiver = Receiver(cells)
        with closing(Sender(reader, theirs)) as sender:
            yield Queue(reader.receiver, sender, theirs, reader)
        cells.close()
        theirs.close()


def test_commands_come_in_the_order_in_which_they_were_sent(queue: Queue) -> None:
    for lap in range(5):
        numbers = [queue.sender.send({"do": "tune", "value": lap * SLOTS + i}) for i in range(SLOTS)]
        taken = [queue.receiver.get() for _ in range(SLOTS)]
        assert [command and command.number for command in taken] == numbers
        assert [command and command.value for command in taken] == [lap * SLOTS + i for i in range(SLOTS)]
    assert queue.receiver.get() is None
    assert (queue.receiver.taken, queue.receiver.dropped) == (5 * SLOTS, 0)


def test_a_full_queue_refuses_after_a_while_and_delays_neither_a_stop_nor_heartbeats(
    queue: Queue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.process.frames.command_queue.SEND_TIMEOUT", 0.01)
    for _ in range(SLOTS):
        queue.sender.send({"do": "tune"})
    with pytest.raises(CommandRefused, match="the queue of commands is full"):
        queue.sender.send({"do": "tune"})
    queue.cells.ask_to_stop(signal.SIGTERM, "ann, a test (pid 1)")
    queue.cells.sign("motor", 7, 1_500_000_000)
    here = ClientMemory(queue.reader.ends.cells, queue.reader.layout)
    assert here.stop == (signal.SIGTERM, "ann, a test (pid 1)")
    assert here.signed("motor", 7) == 1.5
    here.close()


def test_a_command_that_is_too_long_is_refused(queue: Queue) -> None:
    with pytest.raises(CommandRefused, match="too long"):
        queue.sender.send({"do": "call", "path": "x" * MAX_COMMAND_BYTES})


def test_clients_take_turns_and_the_lock_of_one_that_is_stopped_is_waited_for(
    queue: Queue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two senders of one process have got the same descriptor; each opens the memory anew, so the lock is its own."""
    monkeypatch.setattr("umo.process.frames.command_queue.SEND_TIMEOUT", 0.01)
    with closing(Sender(queue.reader, queue.cells)) as other:
        with queue.sender._turn(0.0), pytest.raises(CommandRefused, match="another client has locked"):
            other.send({"do": "tune"})
        assert other.send({"do": "tune"}) == 1


def test_garbage_is_counted_and_dropped_and_commands_come_through_again(queue: Queue) -> None:
    """Anywhere in the cells. Whatever stands there, nothing is raised, and a stop is not asked for by accident."""
    random, memory = Random(1), queue.cells.memory
    for _ in range(2000):
        at = random.choice([HEAD, random.randrange(len(memory)), QUEUE + random.randrange(SLOTS) * SLOT])
        garbage = random.choice([random.randbytes(random.randint(1, 40)), b"\xff" * 8, bytes(8)])[: len(memory) - at]
        memory[at : at + len(garbage)] = garbage
        for _ in range(COMMANDS_PER_PERIOD):
            queue.receiver.get()
        assert queue.cells.stop is None
        for path in ("", "motor", "valve"):
            assert isinstance(queue.cells.signed(path, random.choice([0, 1, 2**64 - 1])), float)
    assert queue.receiver.dropped > 100
    for _ in range(4 * SLOTS):
        queue.receiver.get()
    numbers = [queue.sender.send({"do": "tune"}) for _ in range(3)]
    found = [command for _ in range(SLOTS) if (command := queue.receiver.get()) is not None]
    assert [command.number for command in found] == numbers


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"[]",
        b"3",
        b'{"do": 3}',
        b'{"arguments": []}',
        b"[" * 900,
        b'{"seconds": "x"}',
        b'{"x": 1}',
        b'{"seconds": NaN}',
        b'{"seconds": 1e999}',
        b"\xff\xfe",
    ],
)
def test_a_sound_entry_that_is_not_a_command_is_dropped(queue: Queue, text: bytes) -> None:
    queue.sender._put(0, text)
    assert queue.receiver.get() is None
    assert queue.receiver.dropped == 1
    assert queue.sender.send({"do": "tune"}) == 2
    assert queue.receiver.get() is not None


@pytest.mark.parametrize("head", [SLOTS + 1, 2**63 - 1, 2**64 - 1])
def test_a_head_that_jumps_is_set_right(queue: Queue, head: int) -> None:
    queue.cells.words[HEAD >> 3] = head
    assert queue.receiver.get() is None
    assert (queue.receiver.dropped, queue.cells.words[HEAD >> 3]) == (1, 0)
    assert queue.sender.send({"do": "tune"}) == 1
    assert queue.receiver.get() is not None


def test_a_command_whose_number_is_seen_before_its_text_is_taken_at_the_next_look(queue: Queue) -> None:
    """As a processor with weakly ordered stores may show it."""
    queue.sender.send({"do": "tune"})
    at = slice(QUEUE, QUEUE + SLOT)
    text = bytes(queue.cells.memory[at])
    queue.cells.memory[at] = bytes(SLOT)
    assert queue.receiver.get() is None
    queue.cells.memory[at] = text
    assert queue.receiver.get() is not None
    assert queue.receiver.dropped == 0


@pytest.mark.parametrize("asked", [(0, 0), (1, 0), (signal.SIGTERM, 0), (signal.SIGKILL, STOP_MARK), (77, STOP_MARK)])
def test_nothing_but_a_request_to_stop_stops(queue: Queue, asked: tuple[int, int]) -> None:
    number, word = asked
    queue.cells.words[STOP >> 3] = word | number
    assert queue.cells.stop is None


def test_the_first_request_to_stop_stands_and_its_name_is_cut_and_printable(queue: Queue) -> None:
    queue.cells.ask_to_stop(signal.SIGINT, "\x1b[31m" + "ä" * 100)
    queue.cells.ask_to_stop(signal.SIGTERM, "another")
    asked = queue.cells.stop
    assert asked is not None
    assert asked[0] == signal.SIGINT
    assert asked[1].isprintable()
    assert asked[1].endswith("ä")


# A machine with a queue ---------------------------------------------------------------------------------


def test_a_flood_of_a_client_costs_a_few_commands_in_each_period() -> None:
    with running() as (m, ring, connection), Reader(ring.path) as reader:
        assert reader.ends is not None
        cells = ClientMemory(reader.ends.cells, reader.layout)
        connection.machine.attach(ClientControl(Receiver(cells), cells, Mode.MANUAL))
        periods(m)
        with closing(Sender(reader, cells)) as sender:
            for _ in range(SLOTS):
                sender.send({"do": "tune", "path": "nothing"})
            taken = []
            for _ in range(3):
                periods(m)
                taken.append(reader.taken)
            assert taken == [COMMANDS_PER_PERIOD, 2 * COMMANDS_PER_PERIOD, 3 * COMMANDS_PER_PERIOD]
            assert {each.event.text for each in reader.events()} == {
                "CommandRefused: nobody has the lease; take it first"
            }
        cells.close()


# A running station --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stations(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[pytest.MonkeyPatch], umo.Started]]:
    """Gives a station in manual mode: the same one to tests that leave it as it was, another after one that stops it.
    Their frames and records are in folders of their own."""
    folders = {name: str(tmp_path_factory.mktemp(name.lower())) for name in ("UMO_STATE", "UMO_FRAMES")}
    wiring, begun = conveyor(tmp_path_factory.mktemp("wiring")), list[umo.Started]()

    def station(patch: pytest.MonkeyPatch) -> umo.Started:
        for name, folder in folders.items():
            patch.setenv(name, folder)
        if not begun or begun[-1].outcome is not None:
            begun.append(stack.enter_context(umo.start("conveyor", wiring, manual=True, realtime=True)))
            until(lambda: begun[-1].stage.name == "RUNNING")
        return begun[-1]

    with ExitStack() as stack:
        yield station


@pytest.fixture
def started(stations: Callable[[pytest.MonkeyPatch], umo.Started], monkeypatch: pytest.MonkeyPatch) -> umo.Started:
    return stations(monkeypatch)


@pytest.fixture
def pid(started: umo.Started) -> int:
    return started.pid


def test_what_a_killed_client_held_goes_to_its_default_and_its_lease_ends(pid: int) -> None:
    code = (
        "import sys, time, umo\nstation = umo.attach(int(sys.argv[1]))\n"
        "with station.lease('a client', seconds=1.0):\n"
        "    station.sorter.diverter.write('ON')\n    station.sorter.belt.run_at(0.3)\n"
        "    print('held', flush=True)\n    time.sleep(60)\n"
    )
    client = subprocess.Popen([sys.executable, "-c", code, str(pid)], stdout=subprocess.PIPE)
    assert client.stdout is not None
    assert client.stdout.readline() == b"held\n"
    with umo.attach(pid) as station:
        until(lambda: station.sorter.diverter.read() == "ON" and station.sorter.belt.setpoint.read() > 0.2)
        client.send_signal(signal.SIGKILL)
        client.communicate()
        until(lambda: station.sorter.diverter.read() == "OFF" and station.sorter.belt.setpoint.read() == 0.0)
        until(lambda: station.reader.now().holder == "")
        texts = [event.text for event in station.events]
        assert texts.count("dead-man timeout") == 2  # the actuator, and the action by itself
        assert any("was not renewed" in text for text in texts)


@pytest.mark.full
def test_what_is_held_lasts_under_a_lease_that_is_seldom_renewed(tmp_path: Path) -> None:
    with umo.start("conveyor", conveyor(tmp_path), manual=True, realtime=True) as started:
        until(lambda: started.stage.name == "RUNNING")
        with umo.attach(started.pid) as station, station.lease(seconds=30.0) as lease:
            station.sorter.diverter.write("ON")
            now = station.frames(0.01)["time"][-1]
            until(lambda: station.frames(0.01)["time"][-1] > now + 3 * DEAD_MAN_TIME)
            assert station.sorter.diverter.read() == "ON"
            started.stop()  # a lease that ends with its station ends without a word
            until(lambda: lease.lost)


def test_a_station_that_is_closed_gives_its_lease_back(pid: int) -> None:
    station = umo.attach(pid)
    with station.lease():
        station.sorter.diverter.write("ON")
        station.close()
    with umo.attach(pid) as again:
        assert again.reader.now().holder == ""
        until(lambda: again.sorter.diverter.read() == "OFF")


@pytest.mark.parametrize("seconds", [0.1, 61.0, nan])
def test_a_lease_that_would_end_before_it_is_renewed_is_refused(seconds: float) -> None:
    with (
        running() as (_, ring, _connection),
        RemoteStation(Reader(ring.path)) as station,
        pytest.raises(RangeError, match=r"from 0\.2 to 60 s, not "),
    ):
        station.lease(seconds=seconds)


def test_the_application_waits_until_the_mode_is_automatic(pid: int) -> None:
    """The other tests of this station leave it in manual mode."""
    with umo.attach(pid) as station:
        until(lambda: station.reader.head > 20)
        assert station.progress.text == ""
        with station.lease():
            station.mode = "automatic"
            until(lambda: station.progress.text != "")
            with pytest.raises(CommandRefused, match="in manual mode only"):
                station.sorter.diverter.write("ON")
            station.mode = "manual"


def test_a_program_commands_a_running_station(started: umo.Started) -> None:
    with umo.attach(started.pid) as station:
        until(lambda: station.reader.head > 5)
        assert station.mode == "manual"
        assert {"belt", "push", "window"} <= set(dir(station.sorter))
        assert station.sorter.diverter.read() == "OFF"
        with pytest.raises(CommandRefused, match="nobody has the lease"):
            station.sorter.push()
        with station.lease("a test") as lease:
            assert station.reader.now().holder == "a test"
            with (
                pytest.raises(
                    CommandRefused, match=r"a test has the lease; take it over with station\.lease\(over=True\)"
                ),
                umo.attach(started.pid) as other,
            ):
                other.lease("another").__enter__()
            with pytest.raises(RangeError, match=r"window: 1000 mm is outside 1 to 100"):
                station.sorter.window = 1000.0
            station.sorter.window = 30.0
            assert station.sorter.window == 30.0  # at once
            station.sorter.diverter.write("ON")
            until(lambda: station.sorter.diverter.read() == "ON")
            assert station.sorter.diverter.inhibited == "taken by client: a test"
            station.sorter.diverter.release()
            until(lambda: station.sorter.diverter.read() == "OFF")
            station.sorter.belt.run_at(0.2)
            until(lambda: station.sorter.belt.speed.read() > 0.1)
            station.sorter.belt.run_at(0.0)
            assert not lease.lost
        until(lambda: station.reader.now().holder == "")
        with pytest.raises(AttributeError, match=r"sorter has no 'bellt' \(did you mean 'belt'\?\)"):
            station.sorter.bellt  # noqa: B018
        frames = station.frames(0.05)
        assert set(frames) >= {"time", "sorter.belt.speed", "sorter.length"}
        station.stop("ann, a test (pid 1)")
        until(lambda: not station.running)
        asked, end = station.events[-2:]
        assert (asked.asked, asked.who) == ("stop", "ann, a test (pid 1)")
        assert end.text == "stopped by ann, a test (pid 1)"
        with pytest.raises(FramesError, match="conveyor has ended"):
            station.stop()
    outcome = started.wait(20)
    assert outcome.failure is None
    assert (outcome.stopped_by, outcome.stopped_who) == (signal.SIGTERM, "ann, a test (pid 1)")


def test_the_events_are_in_the_description_of_the_ring_and_readable_by_it_alone() -> None:
    with running() as (m, ring, connection):
        for number in range(600):
            connection.machine.events.add(umo.cycle.events.Event(0.5, "motor", f"happened {number} " + "ä" * 600))
        periods(m, 600 // umo.cycle.events.EVENTS_PER_PERIOD)
        with Reader(ring.path) as reader:
            told = reader.events()
            assert [each.number for each in told] == list(range(88, 600))
            assert told[-1].event.text.startswith("happened 599 ä")
            text = json.loads(reader.layout.describe())["events"]
            assert (text["count"], text["entry_bytes"]) == (512, 776)
