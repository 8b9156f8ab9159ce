"""The ring of frames: what is published, and what readers see of it."""

from __future__ import annotations

import errno
import gc
import json
import os
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from helpers.machines import bench, relay, wired
from helpers.publishing import RingMemory, running, without_times, write, writer
from umo import DigitalSensor, connect, published
from umo.cycle.journal import Journal, Kind
from umo.cycle.phase_times import PhaseTimes
from umo.cycle.showing import frame_of
from umo.errors import DriverError, FramesError
from umo.objects import described
from umo.process.frames import Reader, Ring, Stage, ring, rings
from umo.process.frames.frame_server import folder
from umo.process.frames.layout import EVENT_ROW, Layout
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.ring_copy import RingCopy
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods


@pytest.mark.parametrize("failing", ["sample", "control"])
def test_the_period_that_ends_a_run_with_an_exception_is_a_frame_too(failing: str) -> None:
    box, m = Scripted(), bench()
    connection = connect(m, wired(m, box))
    with pytest.raises((DriverError, ZeroDivisionError)), connection, published(connection, "bench") as ring:
        reader = Reader(ring.path)
        periods(m, 2)
        m.timer.read()
        if failing == "sample":
            box.at(len(box.calls), OSError("cut"))
        m.sample()
        raise ZeroDivisionError
    with reader:
        assert reader.read()["number"].tolist() == [1, 2, 3]


# What is published --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("each_way")
def test_a_frame_is_the_period_as_the_machine_saw_it() -> None:
    box = Scripted({"encoder": [10, 20, 30, 500], "limit": 1})
    with running(box, missed=[0, 3]) as (m, ring, connection), Reader(ring.path) as reader:
        for written in (1.0, -2.5, 4.0):
            m.motor.write(written)
            periods(m)
            frame, image = reader.latest(), connection.image
            assert frame["values"].tolist() == list(image.values)
            assert frame["raws"].tolist() == list(image.raws)
            assert frame["quality"].tolist() == list(image.quality)
            assert frame["values"][reader.index("motor")] == written
        frames = reader.read()
        assert frames["number"].tolist() == [1, 4, 5]
        assert frames["time"].tolist() == pytest.approx([0.001, 0.004, 0.005])
        assert frames["missed"].tolist() == [0, 3, 0]
        assert reader.now().missed == 3
        assert reader.values(frames[0])["limit"] == "FAIL"


def test_the_header_alone_is_enough_to_read_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = RingMemory(monkeypatch)
    with running(valve=relay(synchronous=False)) as (m, _, _):
        m.motor.write(7.5)
        periods(m)
        m.valve.write(OnOff.ON)
        periods(m)
        content = memory.map[:]
    header = struct.unpack_from("<8sIIQQQQQQ", content)
    magic, version, _, first, size, slots, journal, capacity, described = header
    assert (magic, version) == (b"umoframe", 12)
    text = json.loads(content[256 : 256 + described])
    fields = {field["name"]: field for field in text["fields"]}
    paths = [entry["path"] for entry in text["objects"]]
    (head,) = struct.unpack_from("<q", content, 64)
    at = first + (head - 1) % slots * size
    assert struct.unpack_from("<Q", content, at)[0] == 2 * head
    values = np.frombuffer(
        content, fields["values"]["type"], fields["values"]["count"], at + fields["values"]["offset"]
    )
    assert values[paths.index("motor")] == 7.5
    assert text["objects"][paths.index("motor")]["unit"] == "V"
    assert text["objects"][paths.index("valve")]["one"] == "ON"

    def number(name: str) -> int:
        return int(struct.unpack_from("<q", content, at + fields[name]["offset"])[0])

    entry = {field["name"]: field for field in text["journal"]["fields"]}
    assert number("entries") == 1
    begin = journal + number("journal") % capacity * text["journal"]["entry_bytes"]

    def part(name: str) -> int:
        return int(np.frombuffer(content, entry[name]["type"], 1, begin + entry[name]["offset"])[0])

    assert (paths[part("slot")], part("raw"), part("before")) == ("valve", 1, 0)
    assert text["journal"]["kinds"][str(part("kind"))] == "WRITE"
    assert struct.unpack_from("<q", content, 88)[0] <= number("journal") + capacity


def test_phases_add_up_to_the_execution_time() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        periods(m, 5)
        assert reader.layout.phases == ("timer", "try box", "sample box", "control", "update box")
        for frame in reader.read():
            assert frame["phases"][1:].sum() == frame["execution"]
            assert (frame["phases"] >= 0).all()


def test_a_collection_is_counted_in_its_period() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        periods(m, 2)
        gc.collect()
        periods(m, 2)
        counts = np.diff(reader.read()["collections"])
        assert counts[1] >= 1


def told(reader: Reader, frame: Any) -> list[tuple[str, Kind, int, int]]:
    """A frame's journal: path, kind, raw, before."""
    entries = reader.journal(frame)
    assert entries is not None
    return [(reader.paths[slot], Kind(kind), raw, before) for slot, kind, _, raw, before in without_times(entries)]


def test_asynchronous_traffic_is_kept_in_order_with_what_was_before() -> None:
    box = Scripted({"pressure": [0, 0, 412]})
    with running(box, valve=relay(synchronous=False)) as (m, ring, _), Reader(ring.path) as reader:
        m.timer.read()
        m.sample()
        m.valve.write(OnOff.ON)
        m.motor.reset()
        box.broken = OSError("cut")
        with pytest.raises(DriverError):
            m.valve.write(OnOff.OFF)
        box.broken = None
        m.update()
        assert told(reader, reader.latest()) == [
            ("valve", Kind.WRITE, 1, 0),
            ("motor", Kind.RESET, 0, 0),
            ("valve", Kind.FAILED_WRITE, 0, 1),  # what was to be written, and what was there
        ]
        periods(m)
        assert told(reader, reader.latest()) == [("valve", Kind.RESET, 0, 1)]  # its default, sent again
        periods(m)
        assert told(reader, reader.latest()) == []


def test_a_reading_of_an_asynchronous_sensor_is_in_the_journal_and_the_timers_is_not() -> None:
    encoder = DigitalSensor("mm", minimum=0, maximum=1000, resolution=1, synchronous=False)
    box = Scripted({"encoder": [7, 412]})
    with running(box, encoder=encoder) as (m, ring, _), Reader(ring.path) as reader:
        m.timer.read()
        m.sample()
        m.encoder.read()
        m.encoder.read()
        box.broken = OSError("cut")
        with pytest.raises(DriverError):
            m.encoder.read()
        box.broken = None
        m.update()
        assert [(kind, raw) for _, kind, raw, _ in told(reader, reader.latest())] == [
            (Kind.READ, 7),
            (Kind.READ, 412),
            (Kind.FAILED_READ, 412),
        ]
        assert told(reader, reader.latest())[1] == ("encoder", Kind.READ, 412, 7)


def test_a_frame_says_where_in_its_journal_the_transfers_of_the_whole_machine_stood() -> None:
    with running(valve=relay(synchronous=False)) as (_, ring, connection), Reader(ring.path) as reader:
        journal: Journal = ring.journal
        assert (journal.sampled, journal.updated) == (-1, -1)
        journal.add(0, Kind.WRITE, 1, 0)
        journal.sampled = journal.count
        journal.add(0, Kind.WRITE, 0, 1)
        journal.updated = journal.count
        ring(frame_of(connection.machine))
        frame = reader.latest()
        assert (frame["sampled"], frame["updated"], frame["entries"]) == (1, 2, 2)
        ring(frame_of(connection.machine))
        frame = reader.latest()
        assert (frame["sampled"], frame["updated"], frame["entries"]) == (-1, -1, 0)


def test_what_found_no_room_in_the_journal_is_counted() -> None:
    with running() as (_, ring, connection), Reader(ring.path) as reader:
        capacity = ring.journal.capacity
        for number in range(capacity + 5):
            ring.journal.add(0, Kind.WRITE, number, number - 1)
        ring(frame_of(connection.machine))
        frame = reader.latest()
        assert (frame["entries"], frame["entries_lost"]) == (capacity, 5)
        entries = reader.journal(frame)
        assert entries is not None
        assert entries["raw"].tolist() == list(range(capacity))
        ring(frame_of(connection.machine))
        assert reader.latest()["entries_lost"] == 0


def test_the_journal_of_a_frame_is_whole_or_gone() -> None:
    """Through some laps of the journal, with entries over its end."""
    each = 1000
    with running() as (_, ring, connection), Reader(ring.path) as reader:
        for number in range(3 * ring.journal_entries // each):
            write(ring, frame_of(connection.machine), number, each)
        frames = reader.read()
        journals = [reader.journal(frame) for frame in frames]
        there = [entries is not None for entries in journals]
        assert there == [False] * (len(frames) - ring.journal_entries // each) + [True] * (ring.journal_entries // each)
        for frame, entries in zip(frames, journals, strict=True):
            if entries is not None:
                assert entries["raw"].tolist() == [frame["number"]] * each
                assert entries["before"].tolist() == [-frame["number"]] * each


def test_a_machine_without_asynchronous_traffic_has_small_frames() -> None:
    with running() as (_, ring, _connection):
        assert ring.slot_bytes <= 512
        assert ring.slots == 4096


@pytest.mark.usefixtures("each_way")
def test_whoever_looks_while_a_frame_is_being_filled_finds_that_it_is_not_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The sequence number of its slot, looked up before and after its body is written."""
    memory, make, seen = RingMemory(monkeypatch), ring.writer, list[int]()

    def writer_that_looks(*given: Any) -> Any:
        write = make(*given)

        def looking(*body: Any) -> None:
            seen.append(memory.sequence(3))
            write(*body)
            seen.append(memory.sequence(3))

        return looking

    monkeypatch.setattr(ring, "writer", writer_that_looks)
    with running() as (m, frames, connection):
        periods(m, 3)
        seen.clear()
        frames(frame_of(connection.machine))
        assert seen == [7, 7]
        with Reader(frames.path) as reader:
            assert reader.latest()["sequence"] == 8


def test_how_late_the_timer_woke_is_unknown_when_ticks_were_missed() -> None:
    """The tick that a late reader is told of is not the one that it was late for."""

    class Ticking(VirtualTimer):
        ticker = SimpleNamespace(due=1_000, woke=1_250)

    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=Ticking([0, 2, 0])))
    with connection, published(connection, "bench") as ring, Reader(ring.path) as reader:
        periods(m, 3)
        assert reader.read()["wake"].tolist() == [250, -1, 250]


def test_what_the_machine_says_of_its_work_goes_along() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        m.cycle.progress("fräsen " + "x" * 80, done=2, total=3)
        periods(m)
        frame = reader.latest()
        assert frame["progress"].decode().startswith("fräsen xxx")
        assert (frame["done"], frame["total"]) == (2, 3)


# Readers ------------------------------------------------------------------------------------------------


def test_every_frame_is_read_once_and_in_order() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        seen: list[int] = []
        for count in (1, 5, 0, 7):
            periods(m, count)
            seen += reader.read()["number"].tolist()
        assert seen == list(range(1, 14))
        assert reader.lost == 0


def test_a_reader_that_was_lapped_counts_what_it_lost() -> None:
    with running() as (_, ring, connection), Reader(ring.path) as reader:
        frame = frame_of(connection.machine)
        total = 2 * ring.slots + 100
        for number in range(total):
            frame.number = number
            ring(frame)
        frames = reader.read()
        assert len(frames) + reader.lost == total
        assert frames["number"].tolist() == list(range(total - len(frames), total))
        assert len(frames) == ring.slots - 1  # the oldest may be written over at this moment


def test_after_the_end_the_frames_stay_and_the_ring_is_gone() -> None:
    with running() as (m, ring, _):
        reader = Reader(ring.path)
        periods(m, 3)
        assert reader.state is Stage.RUNNING
        assert rings() == [ring.path]
    assert reader.state is Stage.ENDED
    assert reader.read()["number"].tolist() == [1, 2, 3]
    assert rings() == []
    reader.close()
    with pytest.raises(FramesError, match="no frames at"):
        Reader(ring.path)


def test_the_ring_of_a_killed_process_is_recognised_and_removed() -> None:
    with writer("slow") as (process, path), Reader(path) as reader:
        assert rings() == [path]
        assert reader.state is Stage.RUNNING
        process.kill()
        process.wait()
        assert reader.state is Stage.ENDED
        assert len(reader.read()) == 3
        assert rings() == []
        assert not path.exists()


def test_no_torn_frame_at_full_speed() -> None:
    with writer("fast") as (_, path), Reader(path) as reader:
        reader.next = reader.head
        read = kept = 0
        while read < 15_000:
            frames = reader.read()
            number = frames["number"]
            assert (frames["time"] == number).all()
            assert (frames["values"] == number[:, None]).all()
            assert (frames["raws"] == number[:, None]).all()
            for frame in frames[-10:]:
                entries = reader.journal(frame)
                assert entries is None or without_times(entries) == [(0, 0, 0, frame["number"], -frame["number"])]
                kept += entries is not None
            read += len(frames)
        assert kept > 0


def test_a_frame_being_written_is_never_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a reader that ignored the counter would take."""
    memory = RingMemory(monkeypatch)
    with running() as (m, ring, _):
        periods(m, 3)
        with Reader(ring.path) as reader:
            memory.set_sequence(2, 5)  # it is being written
            assert reader.read()["number"].tolist() == [1, 2]
            assert reader.lost == 1
            assert reader.latest()["number"] == 2


def test_copies_over_the_end_of_the_ring_are_like_any_other() -> None:
    """numpy packs the fields of frames that it concatenates."""
    with running() as (_, ring, connection), Reader(ring.path) as reader:
        frame = frame_of(connection.machine)
        for number in range(ring.slots + 10):
            write(ring, frame, number, 0)
            if number == ring.slots - 5:
                plain = reader.read()
        for frames in (reader.last(20), reader.read()):
            assert frames.dtype == plain.dtype == reader.layout.dtype
            assert frames.strides == (ring.slot_bytes,)
            assert frames["number"].tolist() == list(range(ring.slots + 10 - len(frames), ring.slots + 10))


def test_the_last_frame_of_a_ring_that_holds_none_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = RingMemory(monkeypatch)
    with running() as (m, ring, _), Reader(ring.path) as reader:
        assert reader.latest() is None
        assert len(reader.read()) == len(reader.last(5)) == 0
        periods(m)
        memory.set_sequence(0, 0)  # damaged
        assert reader.latest() is None


def test_with_checksums_a_flipped_byte_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    m, memory = bench(), RingMemory(monkeypatch)
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        phases = PhaseTimes(connection.image, connection.wired.drivers)
        layout = Layout(
            tuple(described(each).plain for each in connection.image.items), tuple(phases.names), {"station": "x"}
        )
        ends, readers = RunDescriptors.pair()
        ring = Ring(connection.machine, phases, layout, ends, checksum=True)
        connection.machine.observers.append(ring)
        periods(m, 3)
        with Reader("bench", readers) as reader:
            assert len(reader.last(3)) == 3
            memory.map[memory.slot(1).start + 40] ^= 1
            assert reader.last(3)["number"].tolist() == [1, 3]
            write(ring, frame_of(connection.machine), 4, 2)
            assert told(reader, reader.latest()) == [("encoder", Kind.WRITE, 4, -4)] * 2
            memory.map[memory.places(layout).journal + 8] ^= 1
            assert reader.journal(reader.latest()) is None
            write(ring, frame_of(connection.machine), 5, 0)
            assert told(reader, reader.latest()) == []
        connection.machine.observers.remove(ring)
        ring.close()
        ends.close()


def test_with_checksums_an_event_is_seen_whole_or_not_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where stores are not ordered its number may be seen before its text: the answer of another command."""
    m, memory = bench(), RingMemory(monkeypatch)
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        phases = PhaseTimes(connection.image, connection.wired.drivers)
        layout = Layout(
            tuple(described(each).plain for each in connection.image.items), tuple(phases.names), {"station": "x"}
        )
        ends, readers = RunDescriptors.pair()
        ring = Ring(connection.machine, phases, layout, ends, checksum=True)
        connection.machine.observers.append(ring)
        m.cycle.tell("the first")
        periods(m)
        at = memory.places(layout).events
        row = slice(at, at + EVENT_ROW.itemsize)
        with Reader("bench", readers) as reader:
            (event,) = reader.events()
            assert event.event.text == "the first"
            before = memory.map[row]
            for place in range(8, len(before)):
                memory.map[row.start + place] ^= 1
                assert reader.events() == []
                memory.map[row] = before
            assert reader.events() == [event]
        connection.machine.observers.remove(ring)
        ring.close()
        ends.close()


def test_with_checksums_the_content_of_an_earlier_lap_is_not_taken_for_the_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a processor with weakly ordered stores the new sequence number may be seen before the frame behind it."""
    m, memory = bench(), RingMemory(monkeypatch)
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        phases = PhaseTimes(connection.image, connection.wired.drivers)
        layout = Layout(
            tuple(described(each).plain for each in connection.image.items), tuple(phases.names), {"station": "x"}
        )
        ends, readers = RunDescriptors.pair()
        ring = Ring(connection.machine, phases, layout, ends, checksum=True)
        with Reader("bench", readers) as reader:
            write(ring, frame_of(connection.machine), 0, 0)
            slot = memory.slot(0)
            body = slice(slot.start + 8, slot.stop)  # without the sequence number
            stale = memory.map[body]
            for number in range(1, ring.slots + 1):
                write(ring, frame_of(connection.machine), number, 0)
            assert reader.latest()["number"] == ring.slots
            memory.map[body] = stale
            assert reader.latest()["number"] == ring.slots - 1
        ring.close()


def test_a_copy_of_a_ring_whose_lease_is_not_known_says_that_nobody_has_it() -> None:
    """What comes from another computer may have any number."""
    ends, readers = RunDescriptors.pair()
    ring = RingCopy(Layout((), (), {"station": "x"}), ends)
    with Reader("x", readers) as reader:
        assert reader.now()[1:3] == (0, "")
        ring.lease(7, b"ann")
        assert reader.now()[1:3] == (7, "ann")
        ring.lease(-1, b"")
        assert reader.now()[1:3] == (0, "")
    ring.close()


# Publishing ------------------------------------------------------------------------------------------


def test_a_connection_is_published_once_at_a_time() -> None:
    with running() as (m, ring, connection):
        drivers = [block.driver for block in connection.image.inputs]
        with pytest.raises(FramesError, match="press is already published"), published(connection, "press"):
            pass
        periods(m, 2)
        assert ring.index == 2
        assert [block.driver for block in connection.image.inputs] == drivers


def test_a_connection_can_be_published_again() -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        for _ in range(2):
            with published(connection, "bench") as ring, Reader(ring.path) as reader:
                periods(m, 2)
                assert (reader.latest()["phases"] >= 0).all()
                assert len(reader.read()) == 2
        periods(m)


@pytest.mark.parametrize("calls", [["posix_fallocate"], ["memfd_create"], ["pipe2"], ["dup"], ["rename"]])
def test_a_ring_that_cannot_be_made_leaves_nothing_behind(calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    place = folder()

    def fails(*arguments: Any, **keywords: Any) -> Any:
        raise OSError(errno.EMFILE, "Too many open files")

    def found() -> Any:
        gc.collect()
        return len(gc.callbacks), len(os.listdir("/proc/self/fd")), [b.driver for b in connection.image.inputs]

    with connection:
        before = found()
        with monkeypatch.context() as patched:
            for call in calls:
                patched.setattr(os, call, fails)
            with pytest.raises(FramesError, match=r"frames.*Too many"), published(connection, "bench"):
                pass
        assert found() == before
        assert connection.image.transfer.journal is None
        assert list(place.iterdir()) == []
        periods(m)


# What cannot be attached to, or published ---------------------------------------------------------------


def test_a_ring_of_another_version_is_refused_with_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = RingMemory(monkeypatch)
    with running() as (_, ring, _connection):
        memory.map[8] = 13
        with pytest.raises(FramesError, match="frames of version 13, this umo reads version 12"):
            Reader(ring.path)


def test_a_damaged_description_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = RingMemory(monkeypatch)
    with running() as (_, ring, _connection):
        memory.map[300] ^= 4
        with pytest.raises(FramesError, match="is damaged"):
            Reader(ring.path)


def test_a_folder_or_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(FramesError, match="not a regular file"):
            Reader(path)


@pytest.mark.parametrize("content", [b"", b"nothing", bytes(5000), b"umoframe" + bytes(5000)])
def test_what_is_no_ring_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.frames"
    path.write_bytes(content)
    with pytest.raises(FramesError):
        Reader(path)


def test_a_ring_that_is_cut_short_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    memory = RingMemory(monkeypatch)
    with running():
        content = memory.map[:]
    path = tmp_path / "x.frames"
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(FramesError, match="is truncated"):
        Reader(path)


def test_a_folder_of_frames_that_is_a_link_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "link"))
    with pytest.raises(FramesError):
        folder()


def test_losing_the_socket_does_not_stop_the_machine() -> None:
    with running() as (m, ring, _):
        periods(m, 2)
        ring.path.unlink()
        periods(m, 2)
        assert ring.index == 4
