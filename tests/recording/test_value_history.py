"""The values of a run against time, from four sources: a run, its mirror, its recording, its replay."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from helpers.machines import bench, wired
from helpers.tapes import Case, save
from umo.objects import Quality
from umo.process.frames import Reader
from umo.recording.recorded_history import RecordedHistory
from umo.recording.recording import Recording
from umo.recording.replay.replaying import Replay
from umo.recording.scope.history import History, MemoryHistory, ThinnedHistory, ValueHistory, last_good, samples
from umo.testing import Scripted, periods

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
PERIODS = 60


class Source(NamedTuple):
    """A history, with the times and values that it must have."""

    history: ValueHistory
    times: Any
    values: Any
    """A row for each column."""


def loop(m: Any) -> None:
    for number in range(PERIODS):
        m.motor.write(number % 7)
        periods(m, 1)


CASE = Case(bench, lambda machine: wired(machine, Scripted({"encoder": range(1000)})), loop)


def of_frames(history: ValueHistory, frames: Any) -> Source:
    return Source(history, frames["time"], samples(frames).T)


def read_into(history: MemoryHistory, reader: Reader) -> Any:
    """The frames that are new."""
    frames = reader.read()
    history.add_frames(frames)
    return frames


def live(folder: Path, undo: ExitStack) -> Source:
    from tools.message_orders.feed_world import Station

    station = Station()
    undo.callback(station.reader.close)
    for number in range(PERIODS):
        station.step(0.1 * number)
    history = History(4, 0.1)
    return of_frames(history, read_into(history, station.reader))


def mirrored(folder: Path, undo: ExitStack) -> Source:
    pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    from tools.message_orders.feed_world import FeedWorld
    from tools.message_orders.fleet_net import Net, virtual_fleet

    net = Net("", 0.25, 1.2)
    undo.enter_context(virtual_fleet(net))
    world = FeedWorld(net)
    undo.callback(world.close)
    assert world.join()
    for _ in range(PERIODS):
        world.step()
    history = History(4, 0.1)
    return of_frames(history, read_into(history, world.reader))


def recorded(folder: Path, undo: ExitStack) -> Source:
    tape = CASE.record()
    recording = undo.enter_context(Recording(save(tape, folder / "run.mcap")))
    return of_frames(RecordedHistory(recording), tape.frames)


def replayed(folder: Path, undo: ExitStack) -> Source:
    tape = CASE.record()
    replay = Replay(tape, CASE.program())
    history = ThinnedHistory(len(tape.layout.described.traced), 1000)
    replay.observers.append(
        lambda frame: history.add(np.array([frame.time]), np.array([[*frame.values, *frame.signal_values]]))
    )
    assert replay.run().difference is None
    return of_frames(history, tape.frames)


@pytest.fixture(params=[live, mirrored, recorded, replayed], ids=lambda source: source.__name__)
def source(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Source]:
    make: Callable[[Path, ExitStack], Source] = request.param
    with ExitStack() as undo:
        found = make(tmp_path, undo)
        assert len(found.times) >= 20
        assert len({*found.values[0].tolist(), *found.values[-1].tolist()}) > 5  # values move
        yield found


def test_a_history_begins_with_its_first_sample_and_ends_with_its_last(source: Source) -> None:
    assert (source.history.start, source.history.stop) == (source.times[0], source.times[-1])


def test_a_history_has_every_sample_of_the_chosen_columns_in_their_order(source: Source) -> None:
    history, times, values = source
    found = history.between(times[0], times[-1], [2, 0])
    assert found.times.tolist() == times.tolist()
    assert np.array_equal(found.values, values[[2, 0]], equal_nan=True)


def test_both_ends_of_a_stretch_belong_to_it(source: Source) -> None:
    history, times, values = source
    found = history.between(times[5], times[9], [1])
    assert found.times.tolist() == times[5:10].tolist()
    assert np.array_equal(found.values, values[[1], 5:10], equal_nan=True)


def test_there_is_nothing_before_its_begin_and_behind_its_end(source: Source) -> None:
    history, times, _ = source
    for start, stop in ((times[0] - 2.0, times[0] - 1.0), (times[-1] + 1.0, times[-1] + 2.0)):
        found = history.between(start, stop, [0, 1])
        assert (len(found.times), found.values.shape) == (0, (2, 0))


def test_the_parts_of_a_stretch_are_all_of_it(source: Source) -> None:
    history, times, values = source
    parts = list(history.parts(times[3], times[-2]))
    assert np.concatenate([each.times for each in parts]).tolist() == times[3:-1].tolist()
    joined = np.concatenate([each.values for each in parts], axis=1)
    assert np.array_equal(joined, values[:, 3:-1], equal_nan=True)


def test_points_lose_no_least_and_no_greatest_value(source: Source) -> None:
    history, times, values = source
    step = (times[-1] - times[0]) / 5
    points = history.points(times[0], times[-1], [0, 2], step, float(times[1] - times[0]))
    assert len(points.times) < len(times)
    assert np.nanmin(points.low, axis=1).tolist() == np.nanmin(values[[0, 2]], axis=1).tolist()
    assert np.nanmax(points.high, axis=1).tolist() == np.nanmax(values[[0, 2]], axis=1).tolist()


def test_a_stretch_of_a_few_samples_takes_no_long_time(source: Source) -> None:
    assert source.history.is_short(source.times[0], source.times[-1])


def test_a_history_that_is_thinned_keeps_evenly_spaced_samples_of_all_of_the_run() -> None:
    history = ThinnedHistory(2, 100)
    for first in range(0, 1000, 7):
        numbers = np.arange(first, min(first + 7, 1000), dtype=np.float64)
        history.add(numbers, np.column_stack([numbers, -numbers]))
    times, (row,) = history.between(0.0, 1000.0, [1])
    assert times.tolist() == list(range(0, 1000, 16)) and row.tolist() == (-times).tolist()


def test_an_object_was_read_last_in_the_newest_frame_in_which_it_is_not_stale_or_else_before() -> None:
    frames = np.zeros(3, [("time", "<f8"), ("quality", "u1", (4,))])
    frames["time"] = [1.0, 2.0, 3.0]
    good, range_, stale, bad = Quality.GOOD, Quality.OUT_OF_RANGE, Quality.STALE, Quality.BAD
    frames["quality"] = [[good, range_, stale, bad], [good, range_, bad, bad], [good, stale, bad, bad]]
    found = last_good(frames, np.array([0.0, 0.0, 0.5, np.nan]))
    assert np.array_equal(found, [3.0, 2.0, 0.5, np.nan], equal_nan=True)
