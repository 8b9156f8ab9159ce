"""Recordings on the page: the history of the file, the time that is chosen, two runs laid over one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.helpers.recorded import block_at_random, layout_of
from umo.clients.page import watched_recording
from umo.clients.page.watched_recording import WatchedRecording
from umo.cycle.events import Event
from umo.process.frames.run_reader import NumberedEvent
from umo.recording import recorded_history
from umo.recording.recorded_history import RecordedHistory
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.scope.history import samples

from .conftest import eventually, opened, running, serving

BLOCK, BLOCKS = 100, 6


def event(moment: float, text: str, asked: str = "") -> Event:
    return Event(moment, "part0.object0", text, asked=asked)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """600 periods of 1 ms; an event in each block, a missed period in the fourth, ann has the lease from the third."""
    return written(tmp_path / "one.mcap")


def written(path: Path, seed: int = 0, blocks: int = BLOCKS, first: int = 0) -> Path:
    layout = layout_of(2, 1, place="", wiring="rig", job={"station": "press"})
    objects = tuple(each | {"minimum": 0.0, "maximum": 9.0, "synchronous": True} for each in layout.objects)
    layout = replace(layout, objects=objects)
    made = RecordingFile(path, layout)
    for number in range(blocks):
        block = block_at_random(layout, first + BLOCK * number, BLOCK, seed + number)
        block.frames["quality"], block.frames["restrictions"], block.frames["missed"] = 0, 0, 0
        block.frames["missed"][50] = 3 * (number == 3)
        told = NumberedEvent(number, event(float(block.frames["time"][50]), f"event {number}"))
        live = {"mode": 1, "holder": "ann" if number >= 2 else "", "tunables": []}
        made.add([replace(block, events=[told], live=live)])
    made.close()
    return path


def values_of(path: Path) -> tuple[Any, Any]:
    with Recording(path) as recording:
        frames = recording.frames()
        return frames["time"], samples(frames).T


@pytest.fixture
def run(file: Path) -> Iterator[WatchedRecording]:
    made = WatchedRecording(Recording(file))
    yield made
    made.close()


def history_of(path: Path) -> RecordedHistory:
    return RecordedHistory(Recording(path))


def test_the_history_has_every_sample_of_the_file(file: Path) -> None:
    history, (times, values) = history_of(file), values_of(file)
    found = history.between(0.0, 9.0, [0, 1, 2])
    assert np.array_equal(found.times, times) and np.array_equal(found.values, values)
    found = history.between(0.095, 0.105, [2])
    assert found.times.tolist() == times[95:106].tolist() and found.values.tolist() == values[[2], 95:106].tolist()
    assert (history.start, history.stop) == (times[0], times[-1])


def test_an_overview_loses_no_minimum_and_no_maximum(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    history, (_, values) = history_of(file), values_of(file)
    monkeypatch.setattr(recorded_history, "SHORT", 10)
    monkeypatch.setattr(history, "chunk", None)  # nothing is read
    points = history.points(0.0, 9.0, [0, 2], 0.05, 0.001)
    assert len(points.times) < 40 and not history.is_short(0.0, 9.0)
    assert points.low.min(axis=1).tolist() == values[[0, 2]].min(axis=1).tolist()
    assert points.high.max(axis=1).tolist() == values[[0, 2]].max(axis=1).tolist()


def test_only_so_many_chunks_are_kept(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_history, "MAX_BYTES", 1)
    history = history_of(file)
    for place in range(BLOCKS):
        history.chunk(place)
    assert len(history._read) == 2


def at(run: WatchedRecording, moment: float) -> dict[str, Any]:
    """What pages are told at a time."""
    run.play(moment, False, 1.0)
    run.read()
    run.number += 1
    run._take_state()
    return run._heading() | {"values": run._values()}


@pytest.mark.parametrize("moments", [(0.0, 0.151, 0.599), (0.599, 0.301, 0.0), (0.25, 0.35, 0.25)])
def test_a_time_shows_the_values_the_lease_and_the_missed_periods_of_it(
    run: WatchedRecording, file: Path, moments: Sequence[float]
) -> None:
    times, values = values_of(file)
    for moment in moments:
        told, row = at(run, moment), int(np.searchsorted(times, moment + 1e-9, "right")) - 1
        assert [each[0] for each in told["values"]] == values[:, row].tolist()
        assert told["lease"]["holder"] == ("ann" if moment >= 0.2 else "")
        assert told["missed"] == (3 if moment >= 0.35 else 0)
        assert told["time"] == times[row] and told["stage"] == "running"
        seen = [each.event.text for each in run.reader.events()]
        assert seen == [f"event {number}" for number in range(BLOCKS) if 0.1 * number + 0.05 <= moment + 1e-9]


def test_a_recording_plays_at_its_speed_and_stands_at_its_end(
    run: WatchedRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([100.0, 100.1, 100.2, 200.0, 201.0])
    run._before = 100.0
    monkeypatch.setattr(watched_recording.time, "monotonic", lambda: next(clock))
    run.play(0.1, True, 2.0)
    positions = []
    for _ in range(4):
        run.read()
        positions.append(round(run.position, 3))
    assert positions == [0.1, 0.3, 0.5, 0.599] and not run.playing
    run.play(None, True, 1.0)  # from the beginning
    assert run.position == 0.0 and run.playing


def test_the_second_recording_begins_where_the_first_does(file: Path, tmp_path: Path) -> None:
    other = written(tmp_path / "two.mcap", seed=50, blocks=4, first=1000)  # from 1 s on
    run = WatchedRecording(Recording(file), second=Recording(other))
    try:
        assert "second.part0.object0" in run.columns and run.history.stop == pytest.approx(0.599)
        (times, one), (_, two) = values_of(file), values_of(other)
        found = run.history.between(0.0, 9.0, [0, 3])
        assert np.allclose(found.times, times) and np.array_equal(found.values[0], one[0])
        assert np.array_equal(found.values[1, :400], two[0]) and np.isnan(found.values[1, 400:]).all()
        told = at(run, 0.25)["values"]
        assert [each[0] for each in told] == [*one[:, 250].tolist(), *two[:, 250].tolist()]
        assert [each[0] for each in at(run, 0.5)["values"]][3:] == [None] * 3
        kept = list(run.history.parts(0.0, 9.0))
        assert sum(len(part.times) for part in kept) == 600 and kept[0].values.shape[0] == 6
    finally:
        run.close()


def test_a_page_gets_the_time_that_it_asks_for_and_no_commands(run: WatchedRecording, file: Path) -> None:
    with serving(recorded=run, operate=False) as served, opened(served.socket) as client:
        told = client.get("description")["recording"]
        assert told["files"] == [{"file": "one.mcap", "whole": True, "lost": 0}]
        assert told["replay"] == f"umo recording replay {file}"
        assert len(client.get("state")["events"]) == BLOCKS
        client.send(type="live", id=1, paths=["part0.object0"], span=0.1, width=1000)
        assert client.get("points")[1][-1] == pytest.approx(0.599)
        client.send(type="play", time=0.25, playing=False, speed=1)
        head, times, *_ = client.get("points")
        assert head["from"] == -1.0 and times[-1] == pytest.approx(0.25)
        eventually(lambda: client.get("state")["recording"]["time"] == 0.25)
        client.send(type="command", id=2, do="lease", who="Ann")
        assert client.get("error")["text"] == "this page is read-only"
        for bad in ({"time": "x"}, {"time": 1e999}, {"speed": None}):
            client.send(type="play", playing=True, **bad)
            client.get("error")


def test_a_station_has_no_time_to_choose() -> None:
    with running(), serving() as served, opened(served.socket) as client:
        client.get("description")
        client.send(type="play", time=0.25, playing=False, speed=1)
        assert client.get("error")["text"] == "this is not a recording"


def test_the_slider_moves_scope_and_machine_in_a_browser(page: Any, run: WatchedRecording) -> None:
    with serving(recorded=run, operate=False) as served:
        page.goto(f"{served.url}#view=machine")
        page.locator("[data-path='part0.object0']").first.wait_for()
        assert page.locator(".recording-mark").count() >= 1
        page.locator("#recording input").evaluate("s => { s.value = 0.2; s.dispatchEvent(new Event('input')); }")
        page.get_by_text("0.200 s of 0.599 s").wait_for()
        eventually(lambda: abs(run.position - 0.2) < 1e-6)
        page.get_by_role("button", name="Play", exact=True).click()
        page.get_by_text("0.599 s of 0.599 s").wait_for()
        page.locator("#tab-operate").click()
        page.get_by_text("This is a recording").wait_for()
        assert page.locator("#stop").is_hidden()
