"""Commands from another process: the queue, and `umo.attach`."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest

import umo
from machines import bench, wired
from patient import conveyor
from umo import CommandRefused, FramesError, RangeError, connect, published
from umo.cycle.hands import AT_ONCE, HOLD, Hands, Mode
from umo.frames import Reader
from umo.frames.folder import QUEUE
from umo.process.start import LINUX
from umo.remote.queue import FIRST, HEAD, LONGEST, SLOT, SLOTS, Receiver, Sender
from umo.testing import Scripted, VirtualTimer, periods

pytestmark = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")


# The queue ----------------------------------------------------------------------------------------------


class Machine:
    """What a sender needs of a reader: how many commands the machine has taken."""

    def __init__(self, receiver: Receiver) -> None:
        self.path = receiver.path.with_suffix(".frames")
        self.about = {"station": "bench"}
        self._receiver = receiver

    @property
    def taken(self) -> int:
        return self._receiver.taken


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[tuple[Receiver, Sender]]:
    receiver = Receiver(tmp_path / f"bench{QUEUE}")
    sender = Sender(Machine(receiver))  # type: ignore[arg-type]
    yield receiver, sender
    sender.close()
    receiver.close()
    assert not list(tmp_path.iterdir())


def test_commands_come_in_the_order_in_which_they_were_sent(queue: tuple[Receiver, Sender]) -> None:
    receiver, sender = queue
    for lap in range(5):
        numbers = [sender.send({"do": "tune", "value": lap * SLOTS + i}) for i in range(SLOTS)]
        taken = [receiver.take() for _ in range(SLOTS)]
        assert [command and command.number for command in taken] == numbers
        assert [command and command.value for command in taken] == [lap * SLOTS + i for i in range(SLOTS)]
    assert receiver.take() is None
    assert (receiver.taken, receiver.dropped) == (5 * SLOTS, 0)


def test_a_full_queue_refuses_after_a_while(queue: tuple[Receiver, Sender], monkeypatch: pytest.MonkeyPatch) -> None:
    _, sender = queue
    monkeypatch.setattr("umo.remote.queue.PATIENCE", 0.01)
    for _ in range(SLOTS):
        sender.send({"do": "keep"})
    with pytest.raises(CommandRefused, match="the queue of commands is full"):
        sender.send({"do": "keep"})


def test_a_command_that_is_too_long_is_refused(queue: tuple[Receiver, Sender]) -> None:
    with pytest.raises(CommandRefused, match="too long"):
        queue[1].send({"do": "call", "path": "x" * LONGEST})


def test_garbage_is_counted_and_dropped_and_commands_come_through_again(queue: tuple[Receiver, Sender]) -> None:
    receiver, sender = queue
    random = Random(1)
    file = os.open(receiver.path, os.O_RDWR)
    size = os.fstat(file).st_size
    try:
        for _ in range(2000):
            at = random.choice([HEAD, random.randrange(size), FIRST + random.randrange(SLOTS) * SLOT])
            os.pwrite(file, random.randbytes(random.randint(1, 40)), at)
            if random.random() < 0.1:
                os.ftruncate(file, random.randrange(size + 1))
            for _ in range(AT_ONCE):
                receiver.take()
        assert receiver.dropped > 100
        os.ftruncate(file, size)
        os.pwrite(file, struct.pack("<Q", receiver.taken), HEAD)
        for _ in range(2 * SLOTS):
            receiver.take()
        number = sender.send({"do": "keep"})
        found = [command for _ in range(SLOTS) if (command := receiver.take()) is not None]
        assert [command.number for command in found] == [number]
    finally:
        os.close(file)


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
def test_a_sound_entry_that_is_not_a_command_is_dropped(queue: tuple[Receiver, Sender], text: bytes) -> None:
    receiver, sender = queue
    sender._put(0, text)
    assert receiver.take() is None
    assert receiver.dropped == 1
    assert sender.send({"do": "keep"}) == 2
    assert receiver.take() is not None


def test_a_head_that_jumps_is_not_followed(queue: tuple[Receiver, Sender]) -> None:
    receiver, _ = queue
    file = os.open(receiver.path, os.O_RDWR)
    for head in (SLOTS + 1, 2**63 - 1, 2**64 - 1):
        os.pwrite(file, struct.pack("<Q", head), HEAD)
        assert receiver.take() is None
    os.close(file)
    assert receiver.dropped == 3


# A machine with a queue ---------------------------------------------------------------------------------


def test_a_flood_of_a_client_costs_a_few_commands_in_each_period(tmp_path: Path) -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection, published(connection, "bench", path=tmp_path / "bench.frames") as ring:
        receiver = Receiver(ring.path.with_suffix(QUEUE))
        connection.machine.hands = Hands(connection.machine, receiver, Mode.MANUAL)
        periods(m)
        with Reader(ring.path) as reader:
            sender = Sender(reader)
            for _ in range(SLOTS):
                sender.send({"do": "tune", "path": "nothing"})
            taken = []
            for _ in range(3):
                periods(m)
                taken.append(reader.taken)
            assert taken == [AT_ONCE, 2 * AT_ONCE, 3 * AT_ONCE]
            assert {each.event.text for each in reader.events()} == {
                "CommandRefused: nobody has the lease; take it first"
            }
            sender.close()
        receiver.close()


# A running station --------------------------------------------------------------------------------------


def until(condition: Callable[[], object], patience: float = 20.0) -> None:
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.005)


def test_a_program_commands_a_running_station(tmp_path: Path) -> None:
    with umo.start("conveyor", conveyor(tmp_path), manual=True, realtime=True) as started:
        until(lambda: started.stage.name == "RUNNING")
        with umo.attach(started.pid) as station:
            until(lambda: station.reader.head > 5)
            assert station.mode == "manual"
            assert {"belt", "push", "window"} <= set(dir(station))
            assert station.diverter.read() == "OFF"
            with pytest.raises(CommandRefused, match="nobody has the lease"):
                station.push()
            with station.lease("a test") as lease:
                assert station.reader.holder == "a test"
                with pytest.raises(CommandRefused, match="a test has the lease"), umo.attach(started.pid) as other:
                    other.lease("another").__enter__()
                with pytest.raises(RangeError, match=r"window: 1000 mm is outside 1 to 100"):
                    station.window = 1000.0
                station.window = 30.0
                until(lambda: station.window == 30.0)
                station.diverter.write("ON")
                until(lambda: station.diverter.read() == "ON")
                assert station.diverter.inhibited == "taken by hand: a test"
                station.diverter.release()
                until(lambda: station.diverter.read() == "OFF")
                station.belt.run_at(0.2)
                until(lambda: station.belt.speed.read() > 0.1)
                station.belt.run_at(0.0)
                assert not lease.lost
            until(lambda: station.reader.holder == "")
            with pytest.raises(AttributeError, match=r"the station has no 'bellt' \(did you mean 'belt'\?\)"):
                station.bellt  # noqa: B018
            frames = station.frames(0.05)
            assert set(frames) >= {"time", "belt.speed", "length"}
            station.stop()
            until(lambda: not station.running)
            with pytest.raises(FramesError, match="conveyor has ended"):
                station.stop()
        assert started.wait(20).failure is None


def test_what_a_killed_client_held_goes_to_its_default_and_its_lease_ends(tmp_path: Path) -> None:
    code = (
        "import sys, time, umo\nstation = umo.attach(int(sys.argv[1]))\n"
        "with station.lease('a client', seconds=1.0):\n"
        "    station.diverter.write('ON')\n    station.belt.run_at(0.3)\n"
        "    print('held', flush=True)\n    time.sleep(60)\n"
    )
    with umo.start("conveyor", conveyor(tmp_path), manual=True, realtime=True) as started:
        until(lambda: started.stage.name == "RUNNING")
        client = subprocess.Popen([sys.executable, "-c", code, str(started.pid)], stdout=subprocess.PIPE)
        assert client.stdout is not None
        assert client.stdout.readline() == b"held\n"
        with umo.attach(started.pid) as station:
            until(lambda: station.diverter.read() == "ON" and station.belt.setpoint.read() > 0.2)
            client.send_signal(signal.SIGKILL)
            client.communicate()
            until(lambda: station.diverter.read() == "OFF" and station.belt.setpoint.read() == 0.0, 5.0)
            until(lambda: station.reader.holder == "", 5.0)
            texts = [event.text for event in station.events]
            assert "not kept up" in texts
            assert any("it was not renewed" in text for text in texts)


def test_what_is_held_lasts_under_a_lease_that_is_seldom_renewed(tmp_path: Path) -> None:
    with umo.start("conveyor", conveyor(tmp_path), manual=True, realtime=True) as started:
        until(lambda: started.stage.name == "RUNNING")
        with umo.attach(started.pid) as station, station.lease(seconds=30.0):
            station.diverter.write("ON")
            now = station.frames(0.01)["time"][-1]
            until(lambda: station.frames(0.01)["time"][-1] > now + 3 * HOLD)
            assert station.diverter.read() == "ON"


def test_the_application_waits_until_the_mode_is_automatic(tmp_path: Path) -> None:
    with umo.start("conveyor", conveyor(tmp_path), manual=True, realtime=True) as started:
        until(lambda: started.stage.name == "RUNNING")
        with umo.attach(started.pid) as station:
            until(lambda: station.reader.head > 100)
            assert station.progress.text == ""
            with station.lease():
                station.mode = "automatic"
                until(lambda: station.progress.text != "")
                with pytest.raises(CommandRefused, match="in manual mode only"):
                    station.diverter.write("ON")


def test_the_events_are_in_the_description_of_the_ring_and_readable_by_it_alone(tmp_path: Path) -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection, published(connection, "bench", path=tmp_path / "bench.frames") as ring:
        for number in range(600):
            connection.machine.events.add(umo.cycle.events.Event(0.5, "motor", f"happened {number} " + "ä" * 600))
        periods(m)
        with Reader(ring.path) as reader:
            told = reader.events()
            assert [each.number for each in told] == list(range(88, 600))
            assert told[-1].event.text.startswith("happened 599 ä")
            text = json.loads(reader.layout.describe())["events"]
            assert (text["count"], text["entry_bytes"]) == (512, 768)
