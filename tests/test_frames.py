"""The ring of frames: what is published, and what readers see of it."""

from __future__ import annotations

import errno
import gc
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from machines import Bench, bench, relay, wired
from umo import DriverError, FramesError, OnOff, PathError, connect, published
from umo.cycle.journal import ENTRY, Kind
from umo.cycle.phases import Phases
from umo.frames import Reader, Ring, State, rings
from umo.frames.folder import folder
from umo.frames.layout import EVENTS, Layout, describe_objects
from umo.testing import Scripted, VirtualTimer, periods


@contextmanager
def running(box: Scripted | None = None, *, missed: Any = (), **changes: Any) -> Iterator[tuple[Bench, Ring, Any]]:
    """A bench of five objects that publishes."""
    m = bench(**changes)
    connection = connect(m, wired(m, box or Scripted(), clock=VirtualTimer(missed)))
    with connection, published(connection, "bench") as ring:
        yield m, ring, connection


# What is published --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("both_forms")
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
        assert reader.missed == 3
        assert reader.values(frames[0])["limit"] == "FAIL"


def test_the_header_alone_is_enough_to_read_a_frame() -> None:
    with running() as (m, ring, _):
        m.motor.write(7.5)
        periods(m, 2)
        content = ring.path.read_bytes()
    magic, version, _, first, size, slots, described = struct.unpack_from("<8sIIQQQQ", content)
    assert (magic, version) == (b"umoframe", 1)
    text = json.loads(content[128 : 128 + described])
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


def test_phases_add_up_to_the_execution_time() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        periods(m, 5)
        assert reader.layout.phases == ("timer", "sample box", "control", "update box")
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


def test_asynchronous_traffic_is_kept_in_order_and_bounded() -> None:
    box = Scripted()
    with running(box, valve=relay(synchronous=False)) as (m, ring, connection), Reader(ring.path) as reader:
        m.timer.read()
        m.sample()
        m.valve.write(OnOff.ON)
        m.motor.reset()
        box.broken = OSError("cut")
        with pytest.raises(DriverError):
            m.valve.write(OnOff.OFF)
        box.broken = None
        m.update()
        frame = reader.latest()
        entries = [ENTRY.unpack(bytes(entry)) for entry in frame["journal"][: frame["events"]]]
        slot_of = connection.image.slot_of
        assert [(slot, Kind(kind)) for slot, kind, _, _ in entries] == [
            (slot_of[id(m.valve)], Kind.WRITE),
            (slot_of[id(m.motor)], Kind.RESET),
            (slot_of[id(m.valve)], Kind.FAILED_WRITE),
        ]
        assert entries[0][2:] == (1, 1.0)
        m.timer.read()
        for _ in range(EVENTS + 5):
            m.valve.write(OnOff.ON)
        m.update()
        frame = reader.latest()
        assert (frame["events"], frame["events_lost"]) == (EVENTS, 5)
        periods(m)
        assert reader.latest()["events"] == 0


def test_what_the_machine_says_of_its_work_goes_along() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        m.task, m.placed, m.parts_total = "fräsen " + "x" * 80, 2, 3  # type: ignore[attr-defined]
        periods(m)
        frame = reader.latest()
        assert frame["task"].decode().startswith("fräsen xxx")
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
        frame = connection.machine.frame
        total = 2 * ring.slots + 100
        for number in range(total):
            frame.number = number
            ring(frame)
        frames = reader.read()
        assert len(frames) + reader.lost == total
        assert frames["number"].tolist() == list(range(total - len(frames), total))
        assert len(frames) == ring.slots - 1  # the oldest may be written over at this moment


def test_a_reader_may_attach_late() -> None:
    with running() as (m, ring, _):
        periods(m, 10)
        with Reader(ring.path) as reader:
            periods(m, 2)
            assert reader.read()["number"].tolist() == list(range(1, 13))
            assert reader.read(5)["number"].tolist() == []


def test_after_the_end_the_frames_stay_and_the_ring_is_gone() -> None:
    with running() as (m, ring, _):
        reader = Reader(ring.path)
        periods(m, 3)
        assert reader.state is State.RUNNING
        assert rings() == [ring.path]
    assert reader.state is State.ENDED
    assert reader.read()["number"].tolist() == [1, 2, 3]
    assert rings() == []
    reader.close()
    with pytest.raises(FramesError, match="no frames at"):
        Reader(ring.path)


WRITER = """
import sys
sys.path.insert(0, sys.argv[1])
from test_frames import running
from umo.testing import periods
with running() as (m, ring, connection):
    periods(m, 3)
    print(ring.path, flush=True)
    frame, image = connection.machine.frame, connection.image
    number = 0
    while sys.argv[2] == "fast":
        number += 1
        frame.number, frame.time = number, float(number)
        image.values[:] = [float(number)] * len(image.items)
        image.raws_array.fill(number)
        ring(frame)
    sys.stdin.read()
"""


@contextmanager
def writer(how: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Another process that publishes, at full speed or not at all."""
    command = [sys.executable, "-c", WRITER, str(Path(__file__).parent), how]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, Path(process.stdout.readline().strip())
    finally:
        process.kill()
        process.communicate()


def test_the_ring_of_a_killed_process_is_recognised_and_removed() -> None:
    with writer("slow") as (process, path), Reader(path) as reader:
        assert rings() == [path]
        assert reader.state is State.RUNNING
        process.kill()
        process.wait()
        assert reader.state is State.ENDED
        assert len(reader.read()) == 3
        assert rings() == []
        assert not path.exists()


def test_no_torn_frame_at_full_speed() -> None:
    with writer("fast") as (_, path), Reader(path) as reader:
        reader.next = reader.head
        read = 0
        while read < 50_000:
            frames = reader.read()
            number = frames["number"]
            assert (frames["time"] == number).all()
            assert (frames["values"] == number[:, None]).all()
            assert (frames["raws"] == number[:, None]).all()
            read += len(frames)


def test_a_frame_being_written_is_never_returned() -> None:
    """What a reader that ignored the counter would take."""
    with running() as (m, ring, _):
        periods(m, 3)
        at = ring._first + 2 * ring.slot_bytes
        ring._words[at >> 3] = 5  # frame 2 is being written
        with Reader(ring.path) as reader:
            assert reader._frames[2]["number"] == 3
            assert reader.read()["number"].tolist() == [1, 2]
            assert reader.lost == 1


def test_a_reader_that_dies_while_copying_disturbs_nobody() -> None:
    with running() as (m, ring, _):
        code = f"from umo.frames import Reader\nr = Reader({str(ring.path)!r})\nprint(flush=True)\n"
        code += "while True: r.last(1000)"
        reader = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
        assert reader.stdout is not None
        reader.stdout.readline()
        periods(m, 50)
        reader.send_signal(signal.SIGKILL)
        reader.communicate()
        periods(m, 50)
        assert ring.index == 100


def test_with_checksums_a_flipped_byte_is_noticed() -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        phases = Phases(connection.image, connection.wired.drivers)
        layout = Layout(describe_objects(connection.image.items), tuple(phases.names), {"station": "x"})
        ring = Ring(connection.image, phases, layout, folder() / "x.frames", checksum=True)
        connection.machine.observers.append(ring)
        periods(m, 3)
        with Reader(ring.path) as reader:
            assert len(reader.last(3)) == 3
            ring._bytes[ring._first + ring.slot_bytes + 40] ^= 1
            assert reader.last(3)["number"].tolist() == [1, 3]
        connection.machine.observers.remove(ring)
        ring.close()


# What cannot be attached to, or published ---------------------------------------------------------------


def test_a_ring_of_another_version_is_refused_with_a_sentence() -> None:
    with running() as (_, ring, _connection):
        ring._map[8] = 9
        with pytest.raises(FramesError, match="frames of version 9, this umo reads version 1"):
            Reader(ring.path)


@pytest.mark.parametrize("content", [b"", b"nothing", bytes(5000), b"umoframe" + bytes(5000)])
def test_what_is_no_ring_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.frames"
    path.write_bytes(content)
    with pytest.raises(FramesError):
        Reader(path)


def test_a_ring_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    with running() as (_, ring, _connection):
        content = ring.path.read_bytes()
    path = tmp_path / "x.frames"
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(FramesError, match="cut short"):
        Reader(path)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a file away")
def test_another_users_ring_is_refused() -> None:
    with running() as (_, ring, _connection):
        try:
            os.chown(ring.path, 65534, -1)
        except PermissionError:
            pytest.skip("this root may not give a file away")
        with pytest.raises(FramesError, match=r"another user's \(uid 65534\)"):
            Reader(ring.path)


def test_a_full_disk_is_said_before_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(FramesError, match=r"no room for frames .*No space left"), running():
        pass
    assert list(folder().iterdir()) == []


def test_a_folder_of_frames_that_is_a_link_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "link"))
    with pytest.raises(FramesError):
        folder()


def test_losing_the_file_does_not_stop_the_machine() -> None:
    with running() as (m, ring, _):
        periods(m, 2)
        ring.path.unlink()
        periods(m, 2)
        assert ring.index == 4


def test_an_unknown_path_names_the_nearest() -> None:
    with running() as (_, ring, _connection), Reader(ring.path) as reader, pytest.raises(PathError, match="'motor'"):
        reader.index("moter")
