"""Recordings of real runs in a browser: each view, two runs, rotated sets, flight recorders, many objects, and the
command that is copied."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.recorded import block_at_random, layout_of
from umo.clients.page.watched_recording import WatchedRecording
from umo.process.frames import Layout
from umo.process.job import Job
from umo.recording.record_settings import RecordSettings
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.recording_parts import RecordingParts
from umo_command.run.station_run import Record, run_station

from .conftest import Served, eventually, serving


@pytest.fixture(scope="module")
def conveyor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "it's a run.mcap"
    run_station(Job(station="conveyor"), Record(folder=False, recording=path))
    return path


@contextmanager
def viewed(file: Path, second: Path | None = None) -> Iterator[tuple[WatchedRecording, Served]]:
    run = WatchedRecording(Recording(file), second=None if second is None else Recording(second))
    try:
        with serving(recorded=run, operate=False) as served:
            yield run, served
    finally:
        run.close()


def choose(page: Any, moment: float, then: str = "") -> None:
    """Move the slider to a time, s: it has steps of 10 ms from the first period on. `then`: what follows at once."""
    page.locator("output.recording-time").wait_for()
    setting = f"slider => {{ slider.value = {moment}; slider.dispatchEvent(new Event('input')); {then} }}"
    page.locator("#recording input").evaluate(setting)


def slide(page: Any, run: WatchedRecording, moment: float) -> None:
    """The same, until that time is shown."""
    choose(page, moment)
    eventually(lambda: abs(run.position - moment) < 0.006 and run._shown_at == run.position)


def test_each_view_shows_a_run_at_the_time_of_the_slider(page: Any, conveyor: Path) -> None:
    with viewed(conveyor) as (run, served):
        page.goto(f"{served.url}#view=scope")
        page.locator(".legend tbody tr").first.wait_for()
        slide(page, run, 3.0)
        page.locator("#tab-machine").click()
        speed = page.locator("tr[data-path='sorter.belt.speed']")
        speed.wait_for()
        eventually(lambda: f"{run._values()[run.columns['sorter.belt.speed']][0]:.5f} m/s" in speed.inner_text())
        page.locator("#tab-operate").click()
        page.get_by_text("This is a recording").wait_for()
        assert page.locator("#stop").is_hidden() and page.locator(".answers").is_hidden()
        assert not page.get_by_role("button", name="Take control").is_visible()
        page.locator("#tab-twin").click()
        page.get_by_role("button", name="Reset view").wait_for()
        page.locator("canvas:visible").first.wait_for()
        page.get_by_text("3.002 s of ").wait_for()


@pytest.mark.parametrize("moment", [0.0, 2.34])
def test_the_command_that_is_copied_replays_the_run_and_stops_where_the_slider_stands(
    page: Any, conveyor: Path, moment: float
) -> None:
    """Also where the button is pressed before the server shows the time that was chosen."""
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    with viewed(conveyor) as (run, served):
        page.goto(f"{served.url}#view=machine")
        page.get_by_role("button", name="Copy replay").wait_for()
        choose(page, moment, "document.querySelector('.recording-replay').click()")
        page.get_by_text("Copied").wait_for()
        program, *words = shlex.split(str(page.evaluate("navigator.clipboard.readText()")))
        shown, time = int(run._frame["sequence"]) // 2 - 1, round(float(run._frame["time"]), 9)
        assert abs(run.position - moment) < 0.006 and words[-1] == f"{time:g}s"
    assert program == "umo" and words[:3] == ["recording", "replay", str(conveyor)]
    command = [sys.executable, "-m", "umo_command", *words]
    done = subprocess.run(command, input="p m.now\nq\n", capture_output=True, text=True, timeout=50)
    assert f"period {shown:,}, {time:g} s" in done.stdout and f"(replay) {time:g}" in done.stdout, done


# Rotated sets, flight recorders, many objects -----------------------------------------------------------


def layout(objects: int = 2) -> Layout:
    made = layout_of(objects, 1, place="", wiring="rig", job={"station": "press"})
    ranges = {"minimum": 0.0, "maximum": 9.0, "synchronous": True}
    return replace(made, objects=tuple(each | ranges for each in made.objects))


def rotated(path: Path, settings: RecordSettings) -> Path:
    """12 blocks of 100 periods of 1 ms."""
    parts = RecordingParts(path, layout(), settings=settings)
    for number in range(12):
        block = block_at_random(layout(), 100 * number, 100, number)
        block.frames["quality"], block.frames["missed"] = 0, 0
        parts.add([replace(block, events=[], commands=[], entries_lost=0)])
        if parts._thinning is not None:
            parts._thinning.result()
    parts.close()
    assert len(parts.paths) > 3 and not parts.failed
    return path


def test_a_rotated_set_is_one_run(tmp_path: Path, page: Any) -> None:
    with viewed(rotated(tmp_path / "run.mcap", RecordSettings(rotate=0.2))) as (run, served):
        assert (run.history.start, run.history.stop) == (0.0, pytest.approx(1.199))
        found = run.history.between(0.0, 9.0, [0])
        assert len(found.times) == 1200 and np.isfinite(found.values).all()
        page.goto(f"{served.url}#view=scope")
        page.get_by_text("1.199 s of 1.199 s").wait_for()


def test_of_a_flight_recorder_the_old_part_has_times_and_events_but_no_values(tmp_path: Path, page: Any) -> None:
    with viewed(rotated(tmp_path / "flight.mcap", RecordSettings(last=0.8))) as (run, served):
        found = run.history.between(0.0, 9.0, [0])
        bare = np.isnan(found.values[0])
        assert len(found.times) == 1200 and bare[0] and not bare[-800:].any()
        page.goto(f"{served.url}#view=machine")
        slide(page, run, 0.1)
        page.locator("tr[data-path='part0.object0']").wait_for()
        assert run._values()[0][0] is None


def test_a_thousand_objects_are_shown(tmp_path: Path, page: Any) -> None:
    many = layout(1000)
    file = RecordingFile(tmp_path / "run.mcap", many)
    for number in range(3):
        block = block_at_random(many, 100 * number, 100, number)
        block.frames["quality"] = 0
        file.add([replace(block, events=[])])
    file.close()
    with viewed(tmp_path / "run.mcap") as (run, served):
        page.goto(f"{served.url}#view=machine")
        page.locator("tr[data-path='part0.object0']").wait_for()
        slide(page, run, 0.1)
        page.locator("#tab-scope").click()
        page.get_by_text("0.100 s of 0.299 s").wait_for()
