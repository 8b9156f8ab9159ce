"""One reader of a run, from four sources: a run, its mirror, its recording, its replay."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.machines import bench, wired
from helpers.tapes import Case, save
from umo.errors import PathError
from umo.process.frames import Reader, RunReader, Stage
from umo.process.frames.run_reader import NumberedEvent, RunNow
from umo.process.frames.shown_run import ShownRun
from umo.recording.recorded_history import RecordedHistory
from umo.recording.recording import Recording
from umo.recording.recording_reader import RecordingReader
from umo.recording.replay.replaying import Replay
from umo.testing import Scripted, periods

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
PERIODS = 60


@dataclass
class Source:
    """A run, and how it goes on: `forward` lets a period, or more, pass."""

    reader: RunReader
    forward: Callable[[], object]
    end: Callable[[], object]
    """Ends the run."""


def loop(m: Any) -> None:
    for number in range(PERIODS):
        m.motor.write(number % 7)
        periods(m, 1)


CASE = Case(bench, lambda machine: wired(machine, Scripted({"encoder": range(1000)})), loop)


def live(folder: Path, undo: ExitStack) -> Source:
    from tools.message_orders.feed_world import Station

    station = Station()
    undo.callback(station.reader.close)
    return Source(station.reader, lambda: station.step(0.1 * station.number), lambda: station.end(0.1 * station.number))


def mirrored(folder: Path, undo: ExitStack) -> Source:
    pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    from tools.message_orders.feed_world import FeedWorld
    from tools.message_orders.fleet_net import Net, virtual_fleet

    net = Net("", 0.25, 1.2)
    undo.enter_context(virtual_fleet(net))
    world = FeedWorld(net)
    ended: list[bool] = []
    undo.callback(lambda: world.reader.close() if ended else world.close())
    assert world.join()

    def forward() -> None:
        for _ in range(8):
            world.step()

    def end() -> None:
        world._makes_frames = False
        world.station.end(net.now)
        world._until_ended()
        assert world.mirror is not None
        world.mirror._finish()
        ended.append(True)

    return Source(world.reader, forward, end)


def recorded(folder: Path, undo: ExitStack) -> Source:
    tape = CASE.record()
    recording = undo.enter_context(Recording(save(tape, folder / "run.mcap")))
    run = RecordingReader(recording)
    history, times = RecordedHistory(recording, run.add), iter(tape.frames["time"].tolist())

    def forward() -> None:
        _, chunk, row = history.at(next(times))
        run.show_last(chunk.frames[: row + 1])

    return Source(run, forward, run.close)


def replayed(folder: Path, undo: ExitStack) -> Source:
    tape = CASE.record()
    replay = Replay(tape, CASE.program())
    shown: list[Any] = []

    def look(frame: Any) -> None:
        row = np.zeros(1, tape.layout.dtype)
        row["number"], row["time"], row["missed"] = frame.number, frame.time, frame.missed
        row["values"], row["quality"], row["raws"] = frame.values, frame.quality, frame.raws
        row["signals"] = frame.signal_values
        events = [NumberedEvent(*each) for each in enumerate(replay.connection.machine.events)]
        shown.append((row, RunNow(periods=len(shown) + 1, next_event=len(events)), (), events))

    replay.observers.append(look)
    assert replay.run().difference is None
    run, coming = ShownRun(tape.layout, Path("the replay")), iter(shown)
    return Source(run, lambda: run.show(*next(coming)), run.close)


@pytest.fixture(params=[live, mirrored, recorded, replayed], ids=lambda source: source.__name__)
def source(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Source]:
    make: Callable[[Path, ExitStack], Source] = request.param
    with ExitStack() as undo:
        found = make(tmp_path, undo)
        found.forward()
        yield found


def test_a_source_gives_eight_functions_and_overrides_nothing_that_follows_from_them() -> None:
    given = RunReader.__abstractmethods__
    assert len(given) == 8
    follows = {name for name in vars(RunReader) if not name.startswith("_")} - given - {"alarm_times", "lost", "closed"}
    for kind in (Reader, ShownRun, RecordingReader):
        assert not follows & vars(kind).keys(), kind


def test_what_was_read_is_not_read_again_and_the_newest_is_the_last(source: Source) -> None:
    reader, numbers = source.reader, []
    for _ in range(5):
        frames = reader.read()
        numbers += frames["number"].tolist()
        assert frames[-1].tobytes() == reader.latest().tobytes()  # type: ignore[union-attr]
        assert not len(reader.read())
        source.forward()
    assert numbers == sorted(set(numbers))
    assert len(numbers) >= 5 and reader.lost == 0


def test_no_more_frames_are_read_than_asked_for(source: Source) -> None:
    assert not len(source.reader.read(0))
    assert len(source.reader.read(1)) == 1


def test_another_reader_reads_by_itself(source: Source) -> None:
    other = source.reader.again()
    assert len(source.reader.read()) and len(other.read())
    other.close()
    source.forward()
    assert len(source.reader.read())


def test_the_frames_so_far_are_counted(source: Source) -> None:
    before = source.reader.now().periods
    source.forward()
    assert source.reader.now().periods > before > 0


def test_events_have_consecutive_numbers_up_to_the_next_one(source: Source) -> None:
    for _ in range(10):
        source.forward()
    reader = source.reader
    events = reader.events()
    numbers = [each.number for each in events]
    assert numbers == list(range(numbers[0], reader.now().next_event)) if numbers else not reader.now().next_event
    assert reader.events(reader.now().next_event) == []
    assert reader.events(numbers[-1]) == events[-1:] if numbers else True


def test_values_and_rows_are_those_of_the_frame_in_the_order_of_the_description(source: Source) -> None:
    for _ in range(3):
        source.forward()
    reader, frame = source.reader, source.reader.latest()
    assert frame is not None
    assert list(reader.values(frame)) == reader.paths == [each["path"] for each in reader.layout.objects]
    rows = reader.rows(frame)
    assert [each.about.path for each in rows] == [*reader.paths, *reader.signals, *reader.tunables()]
    assert [each.value for each in rows[: len(reader.paths)]] == frame["values"].tolist()
    assert reader.index(reader.paths[-1]) == len(reader.paths) - 1
    with pytest.raises(PathError, match="no object 'nothing'"):
        reader.index("nothing")


def test_a_run_is_told_in_words(source: Source) -> None:
    facts = source.reader.facts(source.reader.latest())
    assert facts["state"] == "running"
    assert source.reader.title in source.reader.html()


def test_a_run_goes_on_until_it_ends(source: Source) -> None:
    assert source.reader.state is Stage.RUNNING
    source.end()
    assert source.reader.state is Stage.ENDED
