"""Alarms in the frames of a run: the state column, its description, the list of `umo alarm list`, a black box."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from helpers.machines import sensor, timer, wired
from umo import Compound, DigitalSensor, attach, connect, published
from umo.cycle.events import ALARM, Event
from umo.operation.alarms import Alarm, AlarmState, High, Priority
from umo.operation.alarms.alarm_states import Operation
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.operation.alarms.alarming import engine_of
from umo.operation.alarms.engine import AlarmRequest
from umo.operation.commands.verbs import verb_of
from umo.process.frames import Reader, blackbox
from umo.process.frames.alarm_list import alarm_rows
from umo.process.frames.ring import Ring
from umo.testing import Scripted, periods
from umo.text import time_of_day
from umo_command.app import app
from umo_command.do.do_verb import given_arguments
from umo_command.show.stations import attach_first


class Tank(
    Compound,
    alarms={
        "full": Alarm(High("level", 80.0), "too full", priority=Priority.HIGH),
        "empty": Alarm(lambda tank: tank.level.read() < 5.0, "empty"),
    },
):
    timer: DigitalSensor
    level: DigitalSensor


class Fleeting(Compound, alarms={"full": Alarm(High("level", 80.0), "too full", acknowledge=False)}):
    """Its alarm goes with its condition."""

    timer: DigitalSensor
    level: DigitalSensor


@pytest.fixture
def vat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[connect[Tank], Ring]]:
    """A tank that is too full, before its first period, and its frames."""
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    machine = Tank(timer=timer(), level=sensor(resolution=1.0))
    connection = connect(machine, wired(machine, Scripted({"level": 90})))
    with connection, published(connection, "vat") as ring:
        yield connection, ring


@pytest.fixture
def reader(vat: tuple[connect[Tank], Ring]) -> Iterator[Reader]:
    connection, ring = vat
    assert ring.path is not None
    with Reader(ring.path) as reader:
        periods(connection.root, 3)
        yield reader


def test_the_description_tells_paths_states_texts_and_priorities(reader: Reader) -> None:
    full = reader.layout.alarms[0]
    assert (full["path"], full["text"], full["priority"]) == ("full", "too full", "high")
    assert full["states"][AlarmState.LATCHED_ACKNOWLEDGED] == "latched acknowledged"
    frame = reader.latest()
    assert frame is not None
    assert frame["alarms"].tolist() == [AlarmState.UNACKNOWLEDGED, AlarmState.NORMAL]


def test_the_list_has_state_priority_and_time(reader: Reader) -> None:
    (row,) = reader.alarms(reader.latest())
    assert (row.path, row.state, row.priority, row.text) == (
        "full",
        AlarmState.UNACKNOWLEDGED,
        Priority.HIGH,
        "too full",
    )
    assert row.since == pytest.approx(0.001)
    assert reader.facts(reader.latest())["alarms"] == "full: too full (high, unacknowledged)"


def test_a_black_box_keeps_alarms_and_their_events(reader: Reader, tmp_path: Path) -> None:
    blackbox.save(reader, tmp_path / "vat.box", "test")
    with Reader(tmp_path / "vat.box") as box:
        assert [str(row) for row in box.alarms(box.latest())] == ["full: too full (high, unacknowledged)"]
        assert "unacknowledged (high): too full" in [each.event.text for each in box.events()]


def test_an_alarm_that_came_and_went_has_its_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    box = Scripted({"level": 10})
    machine = Fleeting(timer=timer(), level=sensor(resolution=1.0))
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, "vat"):
        for level in (90, 10) * 25:
            box.set("level", level)
            periods(m, 1)
        with attach("vat") as station:
            assert station.alarms == []
            ((path, state, raised, first, last),) = (
                (row.path, row.state, row.raised, row.first, row.last) for row in station.raised_alarms
            )
        assert (path, state, raised) == ("full", AlarmState.NORMAL, 25)
        assert (first, last) == (pytest.approx(0.001), pytest.approx(0.049))
        listed = {option: CliRunner().invoke(app, ["alarm", "list", "vat", *option]) for option in ((), ("--raised",))}
        assert listed[()].stdout == "no alarm is active; `umo alarm list --all` lists all 1\n"
        assert "full" in (shown := listed["--raised",].stdout) and "normal" in shown and "25 since 0.001 s" in shown


def test_umo_alarms_lists_them(reader: Reader) -> None:
    result = CliRunner().invoke(app, ["alarm", "list", "vat", "--json"])
    assert result.exit_code == 0, result.output
    (row,) = json.loads(result.stdout)
    assert (row["path"], row["state"], row["priority"], row["text"]) == ("full", "unacknowledged", "high", "too full")
    shown = CliRunner().invoke(app, ["alarm", "list"]).stdout
    assert "unacknowledged" in shown
    assert "too full" in shown


def test_the_list_of_alarms_shows_the_same_clock_as_their_history(
    reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Reader, "utc", lambda self, frame: 1e9)  # a run in real time
    assert time_of_day(1e9) in CliRunner().invoke(app, ["alarm", "list"]).stdout


def test_an_acknowledged_alarm_keeps_the_time_at_which_it_began_and_shows_who_acknowledged_it(
    vat: tuple[connect[Tank], Ring],
) -> None:
    connection, _ = vat
    m = connection.root
    periods(m, 30)
    engine = engine_of(connection.machine)
    engine.request([0], AlarmRequest(Operation.ACKNOWLEDGE, "ann"))
    periods(m, 3)
    (row,) = json.loads(CliRunner().invoke(app, ["alarm", "list", "--json"]).stdout)
    heads, _, line = CliRunner().invoke(app, ["alarm", "list"]).stdout.splitlines()
    assert (row["state"], row["who"], row["text"]) == ("acknowledged", "ann", "too full")
    assert row["since"] == row["first"] == pytest.approx(0.001)
    assert heads.split() == ["alarm", "state", "by", "priority", "since", "raised", "text"]
    assert line.split() == ["full", "acknowledged", "ann", "high", "0.001", "s", "1", "too", "full"]


def test_a_shelved_alarm_keeps_the_time_at_which_it_began_and_shows_when_the_shelving_ends(
    vat: tuple[connect[Tank], Ring],
) -> None:
    connection, _ = vat
    m = connection.root
    periods(m, 30)
    engine = engine_of(connection.machine)
    engine.request([0], AlarmRequest(Operation.SHELVE, "ann", 600.0, "for 600 s"))
    periods(m, 3)
    (row,) = json.loads(CliRunner().invoke(app, ["alarm", "list", "--json"]).stdout)
    line = CliRunner().invoke(app, ["alarm", "list"]).stdout.splitlines()[-1]
    engine.request([0], AlarmRequest(Operation.UNSHELVE, "ann"))
    periods(m, 3)
    (shown,) = json.loads(CliRunner().invoke(app, ["alarm", "list", "--json"]).stdout)
    assert (row["state"], row["who"]) == ("shelved active", "ann")
    assert row["since"] == row["first"] == pytest.approx(0.001)
    assert row["until"] == pytest.approx(600.031)
    assert "too full; until 600.031 s" in " ".join(line.split())
    assert (shown["state"], shown["until"]) == ("unacknowledged", None)


@pytest.mark.parametrize(("kept", "since"), [(0, 2.0), (1, None)])
def test_without_counts_the_kept_events_tell_since_when_an_alarm_is_active(kept: int, since: float | None) -> None:
    entries = [{"path": "full", "text": "too full", "priority": "high"}]
    events = [
        Event(2.0, "full", "unacknowledged (high): too full", asked=ALARM),
        Event(9.0, "full", "acknowledged (high): too full", "ann", asked=ALARM),
    ]
    (row,) = alarm_rows(entries, [AlarmState.ACKNOWLEDGED], events[kept:], [AlarmTimes()])
    assert (row.since, row.who) == (since, "ann")


def test_all_alarms_that_a_machine_declares_can_be_listed(reader: Reader) -> None:
    rows = json.loads(CliRunner().invoke(app, ["alarm", "list", "--all", "--json"]).stdout)
    assert [(row["path"], row["state"]) for row in rows] == [("full", "unacknowledged"), ("empty", "normal")]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["shelve", "vat", "full", "1 min", "2 min"], "shelve: '2 min' is one argument too many"),
        (["list", "vat", "full"], "got unexpected extra argument"),
    ],
)
def test_a_mistake_in_a_command_of_alarms_is_told_in_a_line(reader: Reader, words: list[str], message: str) -> None:
    result = CliRunner().invoke(app, ["alarm", *words])
    assert (result.exit_code, message in result.stderr) == (2, True), result.stderr


@pytest.mark.parametrize(("words", "rest"), [(["full"], ["full"]), (["vat", "full"], ["full"]), ([], [])])
def test_a_command_of_alarms_needs_no_station_where_one_runs(reader: Reader, words: list[str], rest: list[str]) -> None:
    found, left = attach_first(words)
    with found:
        assert (found.about["station"], left) == ("vat", rest)


@pytest.mark.parametrize("words", [["10", "min"], ["10 min"], ["time=10 min"]])
def test_the_unit_of_a_time_may_be_a_word_of_its_own(words: list[str]) -> None:
    assert given_arguments(verb_of("shelve"), words) == {"time": "10 min"}


def test_without_a_history_it_is_said(reader: Reader) -> None:
    for name in ("vat", str(reader.about["pid"])):
        assert "there is no history of the alarms of vat" in CliRunner().invoke(app, ["alarm", "history", name]).stdout
