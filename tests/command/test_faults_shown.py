"""Faults of equipment in the terminal: after a run, in `umo show stations`, `umo show values`, `umo show why`, and how
they are cleared."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import Result

from helpers.failing_plant import plant
from helpers.waiting import until
from umo import Started, connect, published, start
from umo.cycle.events import FAULT, FAULT_PREFIX, Event, Events
from umo.cycle.fault_log import KEPT_FAULTS, FaultLog
from umo.process.frames.blackbox import folder
from umo.process.start import LINUX
from umo.testing import periods
from umo.testing import station as load
from umo_command.show.stations import attach
from umo_command.show.values_live import WatchScreen

Umo = Callable[..., Result]


def said(result: Result) -> str:
    return " ".join(result.stderr.split())


def table(result: Result) -> dict[str, str]:
    """The last row of each name."""
    rows = (line[1:-1].split("│") for line in result.stdout.splitlines() if line.startswith("│"))
    return {name.strip(): text.strip() for name, text in rows}


@contextmanager
def running(tmp_path: Path) -> Iterator[Any]:
    """The plant in this process; its first two reactors have failed, the first was cleared."""
    m = load(plant(tmp_path)).machine()
    connection = connect(m, plant(tmp_path) / "wiring" / "simulated.toml")
    with connection, published(connection, "plant", "rig"):
        for reactor in m.reactors[:2]:
            reactor.cycle.start(reactor.stumble("no feed"))
        periods(m, 3)
        m.reactors[0].cycle.clear()
        periods(m, 3)
        yield m


# After a run -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [(), ("--realtime", "--rest", "0.1")][: 1 + LINUX])
def test_a_run_tells_its_faults_of_equipment_and_those_that_were_not_cleared(
    umo: Umo, tmp_path: Path, way: tuple[str, ...]
) -> None:
    plant(tmp_path)
    result = umo("run", "plant", "--no-record", "--summary", "sum.json", *way)
    assert result.exit_code == 0, said(result)
    assert "umo: still in fault at the end: reactors.0, since 1.0" in said(result)
    rows = table(result)
    assert rows["faults of equipment"] == "2, 1 not cleared"
    assert rows["reactors.0"].startswith("in fault since 1.0")
    assert rows["reactors.0"].endswith(": no feed 1")
    found = json.loads((tmp_path / "sum.json").read_text())["equipment_faults"]
    assert (found["number"], found["standing"]) == (2, ["reactors.0"])
    first, second = found["last"]
    assert (first["path"], first["reason"], second["reason"]) == ("reactors.0", "no feed 0", "no feed 1")
    assert first["time"] < first["cleared"] < second["time"]
    assert second["cleared"] is None


def test_a_run_without_a_fault_has_no_row_for_them(umo: Umo, tmp_path: Path) -> None:
    plant(tmp_path)
    result = umo("run", "plant", "--no-record", "--faults", "0")
    assert "faults of equipment" not in table(result)
    assert "fault" not in said(result)


def test_of_many_faults_the_last_are_shown_and_the_others_counted(umo: Umo, tmp_path: Path) -> None:
    plant(tmp_path)
    result = umo("run", "plant", "--no-record", "--faults", "12", "--cleared", "12")
    rows = table(result)
    assert rows["faults of equipment"] == "12, all cleared"
    assert rows[""] == "and 7 earlier"
    assert rows["reactors.0"].endswith("no feed 11")
    assert "still in fault" not in said(result)


def test_all_faults_are_counted_the_last_kept_and_what_a_client_says_is_none() -> None:
    log, events = FaultLog(), Events()
    for number in range(KEPT_FAULTS + 5):
        events.add(Event(float(number), "a", f"{FAULT_PREFIX}{number}", asked=FAULT))
        log.add_new(events)
        log.add_new(events)
    assert (log.number, len(log.last), log.last[-1].reason) == (KEPT_FAULTS + 5, KEPT_FAULTS, str(KEPT_FAULTS + 4))
    events.add(Event(0.0, "b", "", "ann", 1, asked=FAULT))
    log.add_new(events)
    assert list(log.standing) == ["a"]


# While it runs -----------------------------------------------------------------------------------------


def test_why_tells_the_faults_whose_events_are_kept(umo: Umo, tmp_path: Path) -> None:
    with running(tmp_path):
        text = " ".join(umo("show", "why", "--now").stdout.split())
    told = "reactors.0: in fault from 0.010 s to 0.030 s: no feed reactors.1: in fault since 0.010 s: no feed "
    assert f"{told}cleared by: umo do plant clear reactors.1 " in text
    assert told in " ".join(umo("show", "why").stdout.split())
    assert "cleared by" not in umo("show", "why").stdout


def test_why_shows_the_black_box_of_the_last_run_and_says_if_it_has_none(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path):
        assert umo("show", "why", "plant", "--now").exit_code == 0
    monkeypatch.chdir(tmp_path)
    for name, hours, has_box in (("plant-1", -1, True), ("plant-2", 1, False)):  # began before the box, and after it
        place = tmp_path / "runs" / name
        place.mkdir(parents=True)
        started = datetime.now().astimezone() + timedelta(hours=hours)
        (place / "run.json").write_text(json.dumps({"station": "plant", "started": started.isoformat()}))
        (place / "summary.json").write_text(json.dumps({"status": 0}))
        for words in (("plant",), ()):
            shown = umo("show", "why", *words).stdout
            assert f"the last run in runs/: {name} ended with status 0" in shown
            assert ("plant (rig), run since 20" in shown) is has_box
            assert ("this run has no black box" in shown) is not has_box
            assert ("an earlier run has one" in shown) is not has_box


def test_why_shows_a_black_box_of_another_machine_that_is_newer_than_the_last_run(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "runs" / "mill-1"
    place.mkdir(parents=True)
    (place / "run.json").write_text(json.dumps({"station": "mill", "started": "2026-01-01T00:00:00+00:00"}))
    (place / "summary.json").write_text(json.dumps({"status": 0}))
    with running(tmp_path):
        assert umo("show", "why", "plant", "--now").exit_code == 0
    monkeypatch.chdir(tmp_path)
    for moment, shows_run in ((0.0, False), (4e9, True)):  # when the folder of the run was last changed
        os.utime(place, (moment, moment))
        for file in place.iterdir():
            os.utime(file, (moment, moment))
        shown = umo("show", "why").stdout
        assert ("the last run in runs/: mill-1" in shown) is shows_run
        assert ("plant (rig), run since 20" in shown) is not shows_run
    assert "the last run in runs/: mill-1" in umo("show", "why", "mill").stdout


def test_why_of_a_running_station_in_fault_shows_the_fault_without_an_option(umo: Umo, tmp_path: Path) -> None:
    with running(tmp_path) as m:
        for box in ("plant-20200101-000000-000.box", "mill-20200101-000000-000.box"):  # of earlier runs
            folder().mkdir(parents=True, exist_ok=True)
            (folder() / box).write_bytes(b"")
            os.utime(folder() / box, (0, 0))
        result = umo("show", "why", "plant")
        assert (result.exit_code, result.stderr) == (0, "")
        assert "reactors.1: in fault since 0.010 s: no feed cleared by: " in " ".join(result.stdout.split())
        m.reactors[2].cycle.start(m.reactors[2].stumble("no seal"))
        periods(m, 3)
        assert "no seal" in umo("show", "why", "plant").stdout  # although there is a black box now
        for reactor in m.reactors:
            reactor.cycle.clear()
        periods(m, 3)
        assert "no seal" in umo("show", "why", "plant").stdout  # it is in the newest black box
    assert "nothing is known of 'press': it is not running" in said(umo("show", "why", "press"))


def test_ps_tells_faults_below_the_table_and_how_they_are_cleared(umo: Umo, tmp_path: Path) -> None:
    with running(tmp_path) as m:
        lines = umo("show", "stations").stdout.splitlines()
        assert "in fault" not in lines[0]
        assert max(map(len, lines)) <= 80
        assert lines[3:] == ["plant: in fault: reactors.1: no feed", "       cleared by: umo do plant clear reactors.1"]
        m.reactors[2].cycle.start(m.reactors[2].stumble("no feed"))
        periods(m, 2)
        assert umo("show", "stations").stdout.splitlines()[5] == "       cleared by: umo do plant clear"
        for reactor in m.reactors:
            reactor.cycle.clear()
        periods(m, 2)
        assert len(umo("show", "stations").stdout.splitlines()) == 3


def test_watch_tells_faults_in_lines_that_fit_the_terminal_and_once(tmp_path: Path) -> None:
    with running(tmp_path), attach("plant") as reader:
        screen = WatchScreen(reader, list(range(len(reader.paths))))
        console = Console(width=40, height=20, file=StringIO(), record=True)
        console.print(screen.screen(console))
        lines = [line.rstrip() for line in console.export_text().splitlines()]
    assert "✕ in fault: reactors.1: no feed" in lines
    assert "in fault" not in lines[1]
    assert not [line for line in lines if line.startswith("⊘ inhibited")]


# Cleared ------------------------------------------------------------------------------------------------


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Started]:
    """The plant in manual mode, in processes of its own."""
    with start(plant(tmp_path), manual=True, realtime=True) as run:
        until(lambda: run.poll(0.01) or (run.frames is not None and run.frames.head > 5))
        yield run


def fail(umo: Umo, started: Started, *numbers: int) -> None:
    frames = started.frames
    assert frames is not None
    for number in numbers:
        assert umo("do", "plant", "call", f"reactors.{number}.fail").exit_code == 0
    until(lambda: set(frames.faults(frames.latest())) >= {f"reactors.{number}" for number in numbers})


@pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")
@pytest.mark.full
def test_clear_takes_paths_and_patterns_and_says_what_it_cleared(umo: Umo, started: Started) -> None:
    for words, cleared in (
        (["reactors.0"], [0]),
        (["reactors.0.heater"], [0]),
        (["reactors.2", "reactors.0.heater"], [2, 0]),
        (["reactors.*"], [0, 1, 2]),
        (["reactors"], [0, 1, 2]),
        (["*.2.heater"], [2]),
    ):
        fail(umo, started, *cleared)
        result = umo("do", "plant", "clear", *words)
        assert result.exit_code == 0, said(result)
        assert result.stdout == "".join(f"cleared: reactors.{number}\n" for number in cleared)
        for more in ([], words):
            assert umo("do", "plant", "clear", *more).stdout.endswith("nothing was in fault\n")
    assert umo("do", "plant", "clear", "timer").stdout == "timer: not part of any equipment\n"
    fail(umo, started, 0, 2)
    assert umo("do", "plant", "clear").stdout == "cleared: reactors.0 and reactors.2\n"
    result = umo("do", "plant", "clear", "reactors.*", "reactor.*.heater")
    assert result.exit_code == 2
    assert "there is no object or signal 'reactor.*.heater' (did you mean 'reactors.*.heater'?) in plant" in said(
        result
    )


@pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")
def test_a_command_that_a_fault_refuses_says_how_it_is_cleared(umo: Umo, started: Started) -> None:
    fail(umo, started, 1)
    for words in (
        ["do", "plant", "call", "reactors.1.heat"],
        ["device", "set", "plant", "reactors.1.heater", "3", "--for", "0"],
    ):
        result = umo(*words)
        assert result.exit_code in (1, 2)
        assert "reactors.1 is in fault" in said(result)
        assert said(result).endswith("cleared by: umo do plant clear reactors.1")
    assert "cleared by" not in said(umo("do", "plant", "call", "reactors.0.heat"))
