"""The recorder: every published frame is in the file, or counted as lost."""

import json
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import bench, wired
from helpers.recorded import block_at_random, layout_of
from helpers.tiers import first
from umo import connect, published
from umo.objects import Compound
from umo.operation.commands.client_control import ClientControl
from umo.process.frames import Reader, Ring
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.command_queue import Receiver, Sender
from umo.process.frames.memory import RunDescriptors
from umo.recording.record_settings import RecordSettings
from umo.recording.recorder import Recorder
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.recording_parts import RecordingParts
from umo.recording.replay.tape import Periods
from umo.recording.tables.recording_summary import facts_of
from umo.testing import Scripted, periods


@contextmanager
def running() -> Iterator[tuple[Compound, Ring, Reader]]:
    m = bench()
    connection = connect(m, wired(m, Scripted()))
    with connection, published(connection, "bench", job={"station": "bench"}) as ring:
        yield m, ring, Reader(ring.path)


@settings(max_examples=4, deadline=None)
@given(st.lists(st.sampled_from([0, 1, 40, 4300]), min_size=1, max_size=3))
def test_every_frame_is_recorded_or_counted_as_lost(looks: list[int]) -> None:
    with tempfile.TemporaryDirectory() as folder, running() as (m, ring, reader):
        path, now = Path(folder) / "run.mcap", [0.0]
        parts = RecordingParts(path, reader.layout)
        recorder = Recorder(reader, parts, clock=lambda: now[0])
        for count in looks:
            periods(m, count)
            now[0] += 0.6
            recorder.look()
        recorder.finish()
        parts.close()
        assert recorder.periods + recorder.lost + (recorder.first or 0) == ring.index
        with Recording(path) as recording:
            assert len(recording.frames()) == recorder.periods
            assert sum(gap.count for gap in recording.gaps) == recorder.lost
            content = reader.layout.content
            rows, last = recording.frames()[-3:], reader.last(3)
            assert [row.tobytes()[:content] for row in rows] == [row.tobytes()[:content] for row in last]
        reader.close()


def test_the_end_of_the_run_is_in_the_file_and_replay_may_begin_at_period_0(tmp_path: Path) -> None:
    with running() as (m, _, reader):
        parts = RecordingParts(tmp_path / "run.mcap", reader.layout)
        recorder = Recorder(reader, parts)
        periods(m, 10)
        recorder.look()
    assert recorder.has_ended
    recorder.finish()
    parts.close()
    assert not recorder.failed
    with Recording(tmp_path / "run.mcap") as recording:
        assert recording.complete and recording.replayable_from is None and recording.events[-1].event.is_end


def test_a_recorder_that_begins_late_says_from_which_period(tmp_path: Path) -> None:
    with running() as (m, _, reader):
        periods(m, reader.slots + 10)
        parts = RecordingParts(tmp_path / "run.mcap", reader.layout)
        recorder = Recorder(reader, parts)
        periods(m, 1)
        recorder.finish()
        parts.close()
        with Recording(tmp_path / "run.mcap") as recording:
            assert recording.replayable_from is not None
            assert f"begins at period {recording.first} " in recording.replayable_from


@contextmanager
def commanded() -> Iterator[tuple[Compound, Reader, Sender]]:
    """A running machine that takes commands, its frames, and a client's queue."""
    m = bench()
    connection = connect(m, wired(m, Scripted()))
    ends, readers = RunDescriptors.pair()
    with connection, published(connection, "bench", job={"station": "bench"}, ends=ends) as ring:
        cells = ClientMemory(ends.cells, ring.layout)
        ring.show(connection.machine.attach(ClientControl(Receiver(cells), cells)))
        with Reader("the run", readers) as reader:
            sender = Sender(reader, cells)
            yield m, reader, sender
            sender.close()
    ends.close()


def test_commands_are_recorded_as_they_came_with_the_period_that_took_them(tmp_path: Path) -> None:
    with commanded() as (m, reader, sender):
        parts = RecordingParts(tmp_path / "run.mcap", reader.layout)
        recorder = Recorder(reader, parts)
        sent = [{"who": "ann", "key": "k", "do": "lease", "seconds": 5.0}, *({"do": f"nothing {n}"} for n in range(8))]
        periods(m, 3)
        for command in sent:
            sender.send(command)
        periods(m, 4)
        recorder.finish()
        parts.close()
    with Recording(tmp_path / "run.mcap") as recording:
        found = recording.commands
        assert [json.loads(each.data) for each in found] == sent
        assert [(each.number, each.period) for each in found] == [(n + 1, 3 + n // 4) for n in range(9)]
        assert recording.frames()["taken"].tolist() == [0, 0, 0, 4, 8, 9, 9]


def test_commands_that_were_written_over_are_counted(tmp_path: Path) -> None:
    with commanded() as (m, reader, sender):
        parts = RecordingParts(tmp_path / "run.mcap", reader.layout)
        recorder = Recorder(reader, parts)
        periods(m, 1)
        recorder.look()
        for _ in range(100):
            sender.send({"do": "nothing"})
            periods(m, 1)
        recorder.finish()
        parts.close()
        assert recorder.commands_lost == 36
    with Recording(tmp_path / "run.mcap") as recording:
        assert [bool(each.data) for each in recording.commands] == [False] * 36 + [True] * 64
        assert not recording.complete


@pytest.mark.parametrize("limits", [RecordSettings(rotate=0.02), RecordSettings(rotate=0.02, keep=1)])
def test_a_rotated_recording_is_one_and_keeps_what_replay_needs(tmp_path: Path, limits: RecordSettings) -> None:
    with running() as (m, _, reader):
        parts = RecordingParts(tmp_path / "run.mcap", reader.layout, settings=limits)
        now = [0.0]
        recorder = Recorder(reader, parts, clock=lambda: now[0])
        for _ in range(30):
            periods(m, 10)
            now[0] += 2.0
            recorder.look()
        recorder.finish()
        parts.close()
        assert len(parts.paths) > 3 and not parts.failed
        with Recording(tmp_path / "run.mcap") as recording:
            frames = recording.frames()
            assert frames["number"].tolist() == list(range(1, 301)) and not recording.gaps
            full = [block.is_full for block in recording.blocks()]
            assert full[-1] and all(full) is (limits.keep is None)
            assert (frames["raws"] == reader.last(300)["raws"]).all()


def test_a_flight_recorder_of_days_begins_a_file_each_hour_as_its_end_grows_with_each_second(tmp_path: Path) -> None:
    layout = layout_of()
    parts = RecordingParts(tmp_path / "run.mcap", layout, settings=RecordSettings(last=10 * 86400.0, rotate=2.0))
    for number in range(10):
        parts.add([block_at_random(layout, 1000 * number, 1000, number)])
    parts.close()
    assert len(parts.paths) == 4


def test_a_recorder_that_is_stopped_before_the_run_does_not_take_it_for_failed(tmp_path: Path) -> None:
    with running() as (m, _, reader):
        parts = RecordingParts(tmp_path / "run.mcap", reader.layout)
        recorder = Recorder(reader, parts)
        periods(m, 10)
        recorder.finish()
        parts.close()
        assert not recorder.failed
    with Recording(tmp_path / "run.mcap") as recording:
        assert not recording.black_boxes and not recording.ended


class OpenThread:
    """Stands for the thread that writes: a write has ended when it is looked at."""

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(work(*arguments))
        return done


@pytest.mark.parametrize("late", first(1, [1, 0, 3]))
def test_a_recorder_that_is_killed_costs_the_last_1_3_seconds_at_most(tmp_path: Path, late: int) -> None:
    """And a chunk has a whole second of the run, whenever the recorder looks. `late`: looks that come late."""
    m, now, most = bench(), [0.0], 0.0
    connection = connect(m, wired(m, Scripted({"encoder": range(7, 100_000)})))
    with connection, published(connection, "bench", job={"station": "bench"}) as frames, Reader(frames.path) as reader:
        file = RecordingFile(tmp_path / "run.mcap", reader.layout)
        follower = Recorder(reader, file, lambda: now[0], OpenThread())  # type: ignore[arg-type]
        period, number = float(reader.about["period"]), 0
        while now[0] < 6.0:
            step = follower.pause * (1 + 0.3 * (number % 7 < late))
            now[0], number = now[0] + step, number + 1
            periods(m, round(now[0] / period) - frames.index)
            most = max(most, (frames.index - follower.periods) * period)
            follower.look()
        follower.finish()
        file.close()
    assert most <= 1.3 and follower.lost == 0
    with Recording(tmp_path / "run.mcap") as recording:
        spans = [recording.chunk(chunk)[0].frames["time"] for chunk in range(recording.chunks)]
        assert [len(each) * period for each in spans[:-1]] == pytest.approx([1.0] * (len(spans) - 1))
        assert len(recording.frames()) == frames.index


@pytest.mark.parametrize(("each", "is_lost"), [(5, False), (20, True)])
def test_every_event_is_recorded_or_counted_as_lost(tmp_path: Path, each: int, is_lost: bool) -> None:
    """By the pauses of a recorder, in a run that tells some, and as many as there may be, in each period."""
    with running() as (m, ring, reader):
        path, now = tmp_path / "run.mcap", [0.0]
        file = RecordingFile(path, reader.layout)
        recorder = Recorder(reader, file, lambda: now[0], OpenThread())  # type: ignore[arg-type]
        period = float(reader.about["period"])
        while now[0] < 1.0:
            now[0] += recorder.pause
            for _ in range(round(now[0] / period) - ring.index):
                for number in range(each):
                    m.cycle.tell(f"event {number}")
                periods(m, 1)
            recorder.look()
        recorder.finish()
        file.close()
        told = reader.now().next_event
    with Recording(path) as recording:
        found = [event.number for event in recording.events]
        assert found == sorted(set(found)) and len(found) + recording.events_lost == told
        assert bool(recorder.events_lost) is is_lost and recording.events_lost == recorder.events_lost
        assert recording._scan.is_exact is not is_lost
        assert facts_of(recording)["events_lost"] == recorder.events_lost
        tape = Periods(recording)
        assert sum(1 for _ in tape) == recording.periods or "events after" in tape.ended
        assert ("events after" in tape.ended) is is_lost
