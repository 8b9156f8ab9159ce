"""Commands from another process: the queue, and `umo.attach`."""

from __future__ import annotations

import json
import mmap
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext
from pathlib import Path
from random import Random

import pytest

import umo
from helpers.machines import bench, wired
from helpers.patient import conveyor
from helpers.waiting import until
from umo import CommandRefused, FramesError, RangeError, connect, published
from umo.cycle.hands import HOLD, TAKEN_PER_PERIOD, Hands, Mode
from umo.frames import Reader, rings
from umo.frames.folder import QUEUE
from umo.frames.layout import BELL, DESCRIPTION
from umo.process.start import LINUX
from umo.remote.queue import ANYWAY, FIRST, HEAD, LONGEST, SLOT, SLOTS, Receiver, Sender
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


def bell_beside(receiver: Path) -> memoryview:
    """That of a ring of frames which has nothing else."""
    ring = receiver.with_suffix(".frames")
    ring.write_bytes(bytes(DESCRIPTION))
    with ring.open("r+b") as file:
        return memoryview(mmap.mmap(file.fileno(), 0)).cast("q")[BELL // 8 : BELL // 8 + 1]


def ends(path: Path, period: float = 0.0) -> Iterator[tuple[Receiver, Sender]]:
    bell = bell_beside(path)
    receiver = Receiver(path, bell, period)
    sender = Sender(Machine(receiver))  # type: ignore[arg-type]
    yield receiver, sender
    sender.close()
    receiver.close()
    bell.release()
    assert list(path.parent.iterdir()) == [path.with_suffix(".frames")]


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[tuple[Receiver, Sender]]:
    """Every look reads the file."""
    yield from ends(tmp_path / f"bench{QUEUE}")


PERIOD = 0.001


@pytest.fixture
def belled(tmp_path: Path) -> Iterator[tuple[Receiver, Sender]]:
    """A look reads the file when the bell says so, and every `ANYWAY` s."""
    yield from ends(tmp_path / f"bench{QUEUE}", PERIOD)


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
            for _ in range(TAKEN_PER_PERIOD):
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


# The bell -----------------------------------------------------------------------------------------------


def reads(receiver: Receiver, monkeypatch: pytest.MonkeyPatch, looks: int) -> int:
    """How many of so many looks read the file."""
    count = 0
    pread = os.pread

    def counted(*arguments: int) -> bytes:
        nonlocal count
        count += 1
        return pread(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pread", counted)
        for _ in range(looks):
            assert receiver.take() is None
    return count


def test_a_look_at_an_empty_queue_does_not_read_the_file(
    belled: tuple[Receiver, Sender], monkeypatch: pytest.MonkeyPatch
) -> None:
    receiver, sender = belled
    every = round(ANYWAY / PERIOD)
    assert reads(receiver, monkeypatch, 10 * every) == 10
    for _ in range(3):
        sender.send({"do": "keep"})
    assert [command.number for command in (receiver.take(), receiver.take(), receiver.take()) if command] == [1, 2, 3]
    assert reads(receiver, monkeypatch, 10 * every) == 10


@contextmanager
def without_bell(sender: Sender) -> Iterator[None]:
    """A hand that dies before it can write it."""
    frames, sender._frames = sender._frames, os.open(os.devnull, os.O_RDWR)
    try:
        yield
    finally:
        os.close(sender._frames)
        sender._frames = frames


def test_a_command_without_a_bell_comes_with_the_next_one(belled: tuple[Receiver, Sender]) -> None:
    receiver, sender = belled
    with without_bell(sender):
        sender.send({"do": "tune"})
    assert receiver.take() is None
    sender.send({"do": "keep"})
    assert [command.do for command in (receiver.take(), receiver.take()) if command] == ["tune", "keep"]


def test_a_command_without_a_bell_is_only_late(belled: tuple[Receiver, Sender]) -> None:
    receiver, sender = belled
    receiver.take()
    with without_bell(sender):
        sender.send({"do": "tune"})
    looks = next(look for look in range(1000) if receiver.take() is not None)
    assert 1 < looks <= round(ANYWAY / PERIOD)


@pytest.mark.parametrize("number", [-(2**63), -1, 1, 7, 2**63 - 1])
def test_a_wrong_bell_loses_no_command(belled: tuple[Receiver, Sender], number: int) -> None:
    receiver, sender = belled
    for _ in range(3):
        sender.send({"do": "keep"})
        os.pwrite(sender._frames, struct.pack("<q", number), BELL)
    taken = [command.number for _ in range(3 * SLOTS) if (command := receiver.take()) is not None]
    assert (taken, receiver.dropped) == ([1, 2, 3], 0)


def test_garbage_in_the_queue_is_found_without_a_bell(belled: tuple[Receiver, Sender]) -> None:
    receiver, sender = belled
    file = os.open(receiver.path, os.O_RDWR)
    os.pwrite(file, struct.pack("<Q", 10 * SLOTS), HEAD)
    os.close(file)
    for _ in range(round(ANYWAY / PERIOD)):
        assert receiver.take() is None
    assert receiver.dropped == 1
    sender.send({"do": "keep"})
    assert receiver.take() is not None


def test_hands_that_die_at_any_moment_lose_no_command_of_the_others(belled: tuple[Receiver, Sender]) -> None:
    """Each write of a hand may be its last: of the entry, of the head, of the bell."""
    receiver, sender = belled
    random, sent = Random(2), 0
    found: list[int] = []
    for _ in range(2000):
        dies = random.choice(["", "", "in the entry", "before the bell"])
        if dies == "in the entry":
            file = os.open(receiver.path, os.O_RDWR)
            os.pwrite(file, random.randbytes(100), FIRST + sent % SLOTS * SLOT)
            os.close(file)
        elif sent - receiver.taken < SLOTS:
            with without_bell(sender) if dies else nullcontext():
                sent = sender.send({"do": "keep"})
        looks = random.choice([0, 1, TAKEN_PER_PERIOD, 2 * round(ANYWAY / PERIOD)])
        found += [command.number for _ in range(looks) if (command := receiver.take()) is not None]
    found += [command.number for _ in range(3 * SLOTS) if (command := receiver.take()) is not None]
    assert (found, receiver.dropped) == ([*range(1, sent + 1)], 0)


# A machine with a queue ---------------------------------------------------------------------------------


def test_a_flood_of_a_client_costs_a_few_commands_in_each_period(tmp_path: Path) -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection, published(connection, "bench", path=tmp_path / "bench.frames") as ring:
        receiver = Receiver(ring.path.with_suffix(QUEUE), ring.bell)
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
            assert taken == [TAKEN_PER_PERIOD, 2 * TAKEN_PER_PERIOD, 3 * TAKEN_PER_PERIOD]
            assert {each.event.text for each in reader.events()} == {
                "CommandRefused: nobody has the lease; take it first"
            }
            sender.close()
        receiver.close()


def test_a_ring_keeps_its_place_when_a_hand_has_written_to_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path))
    with ExitStack() as stack:
        paths = []
        for name in ("b", "a", "c"):
            m = bench()
            connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
            stack.enter_context(connection)
            ring = stack.enter_context(published(connection, name))
            stack.enter_context(closing(Receiver(ring.path.with_suffix(QUEUE), ring.bell)))
            paths.append(ring.path)
        for path in paths[:2]:
            with Reader(path) as reader, closing(Sender(reader)) as sender:
                sender.send({"do": "keep"})
        assert rings() == paths


# A running station --------------------------------------------------------------------------------------


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
                with (
                    pytest.raises(
                        CommandRefused, match=r"a test has the lease; take it over with station\.lease\(over=True\)"
                    ),
                    umo.attach(started.pid) as other,
                ):
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
