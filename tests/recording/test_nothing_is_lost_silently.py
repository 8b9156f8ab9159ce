"""Whatever the ring, the reader, the disk and the rotation do: each frame is in the files, or counted as lost."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import bench, wired
from helpers.tiers import first
from umo import connect, published
from umo.cycle.frame import Frame
from umo.process.frames import Reader, ring
from umo.recording import recorder
from umo.recording.record_settings import RecordSettings
from umo.recording.recorder import Recorder
from umo.recording.recording import Recording
from umo.recording.recording_parts import RecordingParts
from umo.testing import Scripted, periods


class SlowThread:
    """Stands for the thread that writes: a write ends when the disk lets it, or when it is waited for."""

    def __init__(self) -> None:
        self.ready = True

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        thread = self

        class Writing(Future[Any]):
            def done(self) -> bool:
                return thread.ready

            def result(self, timeout: float | None = None) -> Any:
                return work(*arguments)

        return Writing()


STEP = st.tuples(st.integers(0, 60), st.booleans(), st.sampled_from([0.0, 0.3, 1.2]))
"""Periods before a look, whether the disk is ready then, s that pass."""


@pytest.mark.full
@pytest.mark.parametrize("examples", first(1, [40, 1000]))
def test_each_frame_is_in_a_file_or_counted_as_lost(examples: int) -> None:
    @settings(max_examples=examples)
    @given(
        steps=st.lists(STEP, min_size=1, max_size=12), slots=st.integers(16, 70),
        rotate=st.sampled_from([0.01, 0.05, 9]), keep=st.sampled_from([None, 1]), threaded=st.booleans(),
    )  # fmt: skip
    def check(**case: Any) -> None:
        with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
            recorded_as_published(patch, Path(folder), **case)

    check()


def recorded_as_published(
    patch: pytest.MonkeyPatch,
    folder: Path,
    steps: list[tuple[int, bool, float]],
    slots: int,
    rotate: float,
    keep: int | None,
    threaded: bool,
) -> None:
    patch.setattr(ring, "MAX_SLOTS", slots)
    patch.setattr(recorder, "MAX_WAITING", 30_000)
    m, told, now = bench(), list[tuple[float, ...]](), [0.0]
    connection = connect(m, wired(m, Scripted({"encoder": range(7, 10_000, 3)})))
    thread = SlowThread() if threaded else None
    with connection, published(connection, "bench", job={"station": "bench"}) as frames, Reader(frames.path) as reader:
        connection.machine.observers.append(lambda frame: told.append(_row(frame, m)))
        parts = RecordingParts(folder / "run.mcap", reader.layout, settings=RecordSettings(rotate=rotate, keep=keep))
        follower = Recorder(reader, parts, lambda: now[0], thread)  # type: ignore[arg-type]
        for count, ready, passed in steps:
            periods(m, count)
            now[0] += passed
            if thread is not None:
                thread.ready = ready
            follower.look()
        follower.finish()
        parts.close()
        published_count = frames.index
    assert not parts.failed
    if not published_count:
        return
    with Recording(folder / "run.mcap") as recording:
        kept, gaps = recording.frames(), recording.gaps
        numbers = (kept["sequence"].astype(np.int64) // 2 - 1).tolist()
        lost = [number for gap in gaps for number in range(gap.first, gap.first + gap.count)]
        assert sorted([*range(follower.first or 0), *numbers, *lost]) == list(range(published_count))
        assert numbers == sorted(numbers) and len(numbers) == follower.periods and len(lost) == follower.lost
        assert [told[number][0] for number in numbers] == kept["time"].tolist()
        place = [each["path"] for each in recording.layout.objects].index("encoder")
        assert [told[number][1] for number in numbers] == kept["raws"][:, place].tolist()
        for block in recording.blocks(full=False):
            journals = [block.journal(row) for row in range(len(block.frames))]
            assert sum(journal is None for journal in journals) <= block.entries_lost


def _row(frame: Frame, m: Any) -> tuple[float, ...]:
    return frame.time, m.encoder.raw
