"""Black boxes: what is in them, and that keeping one never costs more than the box."""

from __future__ import annotations

import errno
import os
import random
import signal
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from helpers import process_box
from helpers.machines import bench, wired
from helpers.publishing import running, write
from helpers.runs import Run
from helpers.waiting import until
from umo import connect, published
from umo.cycle.phase_times import PhaseTimes
from umo.cycle.showing import frame_of
from umo.errors import FramesError
from umo.objects import described
from umo.process import frame_watcher
from umo.process.frame_watcher import FrameWatcher
from umo.process.frames import Layout, Reader, Ring, Stage, blackbox, causes
from umo.process.frames.blackbox import boxes, folder, save
from umo.process.frames.layout import ENTRY, arrange
from umo.process.frames.memory import RunDescriptors, fill
from umo.process.run_state import RunState, Who
from umo.system import calls
from umo.testing import Scripted, VirtualTimer, periods
from umo_command.app import app
from umo_command.show.why import why


@contextmanager
def box_of(ring: Ring, path: Path, periods: int = blackbox.KEPT_PERIODS) -> Iterator[Reader]:
    with Reader(ring.path) as reader:
        save(reader, path, "for a test", periods)
    with Reader(path) as box:
        yield box


@pytest.mark.parametrize("beyond", [-300, 0, 1, 10, 500, 999, 1500])
def test_a_box_reads_like_the_ring_wherever_its_frames_lay(tmp_path: Path, beyond: int) -> None:
    """Over the end of the ring as well."""
    with running() as (_, ring, connection):
        head = ring.slots + beyond
        for number in range(head):
            write(ring, frame_of(connection.machine), number, number % 3)
        with box_of(ring, tmp_path / "x.box") as box:
            frames = box.read()
            assert frames["number"].tolist() == list(range(head - blackbox.KEPT_PERIODS, head))
            assert (box.lost, box.head, box.state) == (0, head, Stage.ENDED)
            assert box.about["reason"] == "for a test"
            assert box.latest()["number"] == head - 1
            for frame in frames[-50:]:
                entries = box.journal(frame)
                assert entries is not None
                assert entries["raw"].tolist() == [frame["number"]] * (int(frame["number"]) % 3)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_box_of_few_frames_holds_them_all(tmp_path: Path, count: int) -> None:
    with running() as (m, ring, _):
        periods(m, 20)
        with box_of(ring, tmp_path / "x.box", count) as box:
            assert box.latest()["number"] == 20
            assert box.read()["number"].tolist() == list(range(21 - count, 21))


def test_a_box_of_a_ring_that_has_ended_holds_its_oldest_frame() -> None:
    with running() as (_, ring, connection):
        reader = Reader(ring.path)
        for number in range(ring.slots + 10):
            write(ring, frame_of(connection.machine), number, 0)
    with reader.again() as again:
        assert again.read()["number"].tolist() == list(range(10, ring.slots + 10))
    reader.close()


def test_a_box_holds_what_the_journal_still_had(tmp_path: Path) -> None:
    each = 1000
    with running() as (_, ring, connection):
        kept = ring.journal_entries // each
        for number in range(kept + 4):
            write(ring, frame_of(connection.machine), number, each)
        with box_of(ring, tmp_path / "x.box") as box:
            frames = box.read()
            there = [box.journal(frame) is not None for frame in frames]
            assert there == [False] * 4 + [True] * kept
            entries = box.journal(frames[-1])
            assert entries is not None
            assert entries["before"].tolist() == [-(kept + 3)] * each


def test_a_box_of_a_ring_with_checksums_is_checked_too(tmp_path: Path) -> None:
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection:
        phases = PhaseTimes(connection.image, connection.wired.drivers)
        layout = Layout(
            tuple(described(each).plain for each in connection.image.items), tuple(phases.names), {"station": "x"}
        )
        ends, readers = RunDescriptors.pair()
        ring = Ring(connection.machine, phases, layout, ends, checksum=True)
        for number in range(5):
            write(ring, frame_of(connection.machine), number, 2)
        with Reader("x", readers) as reader:
            blackbox.save(reader, tmp_path / "x.box", "a test")
        with Reader(tmp_path / "x.box") as box:
            assert len(box.read()) == 5
            entries = box.journal(box.latest())
            assert entries is not None
            assert entries["raw"].tolist() == [4, 4]
            content = bytearray((tmp_path / "x.box").read_bytes())
            journal = box._places.journal
            content[journal - 3 * ring.slot_bytes + 40] ^= 1  # in the last frame but two
            content[journal + 9 * ENTRY.itemsize + 8] ^= 1  # in the last entry
            (tmp_path / "y.box").write_bytes(content)
        with Reader(tmp_path / "y.box") as damaged:
            assert damaged.read()["number"].tolist() == [0, 1, 3, 4]
            assert damaged.journal(damaged.last(2)[0]) is not None
            assert damaged.journal(damaged.latest()) is None
        ring.close()
        ends.close()


def test_a_box_before_the_first_frame_is_empty_and_says_so(tmp_path: Path) -> None:
    with running() as (_, ring, _connection), box_of(ring, tmp_path / "x.box") as box:
        assert box.latest() is None
        assert len(box.read()) == 0
    result = CliRunner().invoke(app, ["show", "why", "--file", str(tmp_path / "x.box")])
    assert result.exit_code == 2
    assert "contains no period" in result.stderr


def test_others_may_look_past_the_black_boxes_for_records_but_not_into_them() -> None:
    """Or the records of this user would be unknown to them, and every start of theirs refused."""
    folder = blackbox.folder()
    assert [stat.S_IMODE(path.stat().st_mode) for path in (folder.parent, folder)] == [0o755, 0o700]


def test_a_disk_that_fills_up_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(calls, "replace", full)
    with running() as (m, ring, _), Reader(ring.path) as reader:
        periods(m, 3)
        with pytest.raises(OSError, match="No space left"):
            save(reader, tmp_path / "x.box", "")
    assert not [path for path in tmp_path.iterdir() if path.is_file()]


def test_why_bears_every_damage_of_a_box(tmp_path: Path) -> None:
    with running(missed=[0, 0, 0, 2]) as (m, ring, _):
        periods(m, 20)
        with box_of(ring, tmp_path / "x.box"):
            pass
    content = (tmp_path / "x.box").read_bytes()
    chance = random.Random(1)
    for at in [*range(128), *(chance.randrange(len(content)) for _ in range(20))]:
        damaged = bytearray(content)
        damaged[at] ^= chance.choice([1, 2, 16, 128, 255])
        (tmp_path / "y.box").write_bytes(damaged)
        with suppress(FramesError):
            assert why(None, False, tmp_path / "y.box") == 0


def test_why_of_a_folder_is_an_error_in_a_line(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["show", "why", "--file", str(tmp_path)])
    assert result.exit_code == 2
    assert "is not a file" in " ".join(result.stderr.split())


# The guardian's watcher ----------------------------------------------------------------------------------

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@contextmanager
def watched(missed: Any = (), failure: str = "") -> Iterator[tuple[FrameWatcher, Any]]:
    """A machine whose ring a watcher follows; how it failed is told after its end."""
    seen = FrameWatcher("bench")
    assert seen.make() == ""
    assert seen.frames is not None
    ends, server = seen.frames
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer(missed)))
    with connection, published(connection, "bench", ends=ends):
        server.listen()
        yield seen, m
    if failure:
        seen.keep(failure)
    seen.finish()
    assert not server.path.exists()
    ends.close()
    server.ends.close()


def reasons() -> list[str]:
    found = []
    for path in boxes(folder()):
        with Reader(path) as box:
            found.append(box.about["reason"])
    return sorted(found)


def test_a_failed_end_is_kept_though_another_box_was_just_kept_or_is_being_written() -> None:
    with watched() as (seen, m):
        periods(m, 3)
        seen.keep("a period was missed")
        seen.keep("it hung")
    assert reasons() == ["a period was missed", "it hung"]


def test_a_miss_shortly_before_the_end_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.process.frames.blackbox.AFTERMATH", 1000.0)
    with watched([0, 0, 5]) as (seen, m):
        periods(m, 3)
        seen.look()
    assert reasons() == ["a period was missed"]


def test_an_end_is_kept_though_nobody_looked_before_it() -> None:
    with watched(failure="it failed") as (_, m):
        periods(m, 3)
    assert reasons() == ["it failed"]


def test_misses_are_kept_once_in_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.process.frames.blackbox.AFTERMATH", 0.0)
    with watched([0, 0, 5, 5, 5]) as (seen, m):
        seen.look()
        for _ in range(5):
            periods(m)
            seen.look()
    assert reasons() == ["a period was missed"]


def test_a_fork_that_fails_costs_the_box(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> int:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    with watched() as (seen, m):
        periods(m, 3)
        with monkeypatch.context() as patched:
            patched.setattr(os, "fork", fails)
            seen.keep("it hung")
            seen.look()
        seen.keep("later")
    assert reasons() == ["later"]


def test_a_full_disk_costs_the_box(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(blackbox, "save", full)
    with watched() as (seen, m):
        periods(m, 3)
        seen.keep("it hung")
    assert reasons() == []


@pytest.mark.parametrize("content", [b"", b"umoframe" + bytes(200), bytes(5000), b"\xff" * 5000])
def test_a_ring_that_cannot_be_read_costs_the_box(content: bytes) -> None:
    """Nor one that is not sealed: another process could cut it while it is read."""
    seen = FrameWatcher("bench")
    assert seen.make() == ""
    assert seen.frames is not None
    os.write(seen.frames[0].frames, content)
    seen.look()
    if content:
        fill(seen.frames[0].frames, content, len(content), private=True).close()
    seen.look()
    seen.keep("it hung")
    seen.finish()
    assert reasons() == []
    for ends in (seen.frames[0], seen.frames[1].ends):
        ends.close()


def test_frames_whose_cells_never_come_cost_no_descriptors() -> None:
    """There was memory for the ring, and then no more: a look finds the one without the other."""
    seen = FrameWatcher("bench")
    assert seen.make() == ""
    assert seen.frames is not None
    head, places = arrange(Layout((), (), {"station": "bench"}), 16, 16)
    fill(seen.frames[0].frames, head, places.size, private=True).close()
    seen.look()
    before = os.listdir("/proc/self/fd")
    for _ in range(3):
        seen.look()
    assert os.listdir("/proc/self/fd") == before
    seen.finish()
    for ends in (seen.frames[0], seen.frames[1].ends):
        ends.close()


def test_without_a_folder_for_frames_there_is_nothing_to_watch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "file" / "frames"))
    seen = FrameWatcher("bench")
    assert "the folder for frames cannot be used" in seen.make()
    seen.look()
    seen.keep("it hung")
    seen.finish()


def test_a_box_that_takes_for_ever_does_not_hold_up_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """And its process keeps nothing of the guardian's open."""
    held, holding = os.pipe()

    def sticks(*_: object) -> None:
        while True:
            signal.pause()

    monkeypatch.setattr(frame_watcher, "BLACK_BOX_TIMEOUT", 0.01)
    monkeypatch.setattr(blackbox, "save", sticks)
    with watched() as (seen, m):
        periods(m, 3)
        seen.keep("it hung")
        child = seen._child
    os.close(holding)
    assert os.read(held, 1) == b""  # nobody else has the other end
    assert child is not None
    assert child.end(20.0)
    os.close(held)


def test_the_cause_is_found_in_a_box_that_was_taken_over_the_rings_end(tmp_path: Path) -> None:
    with running() as (_, ring, connection):
        frame = frame_of(connection.machine)
        for number in range(ring.slots + 100):
            frame.missed = 2 if number == ring.slots + 50 else 0
            write(ring, frame, number, 0)
        with box_of(ring, tmp_path / "x.box") as box:
            frames = box.read()
            (verdict,) = causes.explain_all(frames, box.layout)
            assert verdict.missed == 2


def test_a_guardian_that_waits_for_a_box_is_not_taken_for_dead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Until the standby guardian has looked more often than it bears of one that watches."""
    gone, save, looks, saved = RunState.gone, blackbox.save, tmp_path / "looks", tmp_path / "saved"

    def counted(self: RunState, within: float, who: Who = Who.CONTROL) -> bool:
        if who is Who.GUARDIAN:
            with looks.open("a") as file:
                file.write(".")
        return gone(self, within, who)

    def slow(*arguments: Any) -> None:
        before, guardian = looks.stat().st_size, os.getppid()
        until(lambda: looks.stat().st_size > before + 25 or os.getppid() != guardian)
        with saved.open("a") as file:
            file.write(".")
        save(*arguments)

    monkeypatch.setattr(RunState, "gone", counted)
    monkeypatch.setattr(blackbox, "save", slow)
    run = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "2 s"}), "fail_at")
    assert run.outcome().status == 1
    assert saved.read_text() == "."
    assert len(reasons()) == 1
