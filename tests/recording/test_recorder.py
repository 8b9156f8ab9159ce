"""The recorder: every published frame is in the file, or counted as lost."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import bench, wired
from umo import connect, published
from umo.frames import Reader, Ring
from umo.objects import Compound
from umo.recording import Recording
from umo.recording.record_settings import RecordSettings
from umo.recording.recorder import Recorder
from umo.recording.recording_parts import RecordingParts
from umo.testing import Scripted, periods


@contextmanager
def running() -> Iterator[tuple[Compound, Ring, Reader]]:
    m = bench()
    connection = connect(m, wired(m, Scripted()))
    with connection, published(connection, "bench", job={"station": "bench"}) as ring:
        yield m, ring, Reader(ring.path)


@settings(max_examples=8, deadline=None)
@given(st.lists(st.sampled_from([0, 1, 40, 4000, 4500]), min_size=1, max_size=3))
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
