"""`umo do STATION mode`, `call`, `tune`, `stop`, and `umo device set` of a station that runs."""

from __future__ import annotations

import json
import os
import re
import signal
import threading
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

import umo
from helpers import patient
from helpers.waiting import until
from umo.clients.remote import HeldLease
from umo.process.frames.search import readers
from umo.process.start import LINUX
from umo.system.device_record import DeviceClaim, all_standing
from umo_command.app import app
from umo_command.values import argument, state

pytestmark = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")


FOLDERS = ("UMO_FRAMES", "UMO_STATE")


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[umo.Started, dict[str, str]]]:
    """One for all tests, in manual mode; its frames and records are in folders of its own."""
    folders = {name: str(tmp_path_factory.mktemp(name.lower())) for name in FOLDERS}
    with pytest.MonkeyPatch.context() as patch:
        for name, folder in folders.items():
            patch.setenv(name, folder)
        with umo.start(
            "conveyor", patient.conveyor(tmp_path_factory.mktemp("wiring")), manual=True, realtime=True
        ) as started:
            until(lambda: started.poll(0.01) or (started.frames is not None and started.frames.head > 5))
            yield started, folders


@pytest.fixture
def conveyor(started: tuple[umo.Started, dict[str, str]], monkeypatch: pytest.MonkeyPatch) -> umo.Started:
    for name, folder in started[1].items():
        monkeypatch.setenv(name, folder)
    return started[0]


HELD = [
    ["do", "conveyor", "write", "sorter.diverter", "ON"],
    ["do", "conveyor", "call", "sorter.belt.run_at", "speed=0.1"],
]
"""Commands that hold something until Ctrl-C."""


def once_held(patch: pytest.MonkeyPatch, deed: Callable[[HeldLease], object]) -> None:
    """Do this when a command has begun to hold something."""
    ended, deeds = HeldLease.ended, [deed]

    def after(self: HeldLease, path: str) -> str:
        if deeds:
            deeds.pop()(self)
        return ended(self, path)

    patch.setattr(HeldLease, "ended", after)


def run(*words: str) -> Result:
    return CliRunner().invoke(app, [*words])


def test_the_name_of_an_action_in_the_place_of_a_command_is_told_how_to_call_it(conveyor: umo.Started) -> None:
    result = run("do", "conveyor", "run_at")
    assert result.exit_code == 2
    assert "there is no command 'run_at', but an action: `umo do conveyor call sorter.belt.run_at`" in result.stderr


def said(result: Result) -> str:
    return " ".join(result.stderr.split())


def test_the_actions_are_listed_with_units_and_ranges(conveyor: umo.Started) -> None:
    result = run("do", "conveyor", "call")
    assert result.exit_code == 0, said(result)
    assert "speed=0 to 1 m/s" in result.stdout
    assert "as long as it is held" in result.stdout
    assert "Push anything in front of the diverter onto the chute." in result.stdout


def test_a_choice_is_taken_in_small_letters_as_it_is_shown() -> None:
    about = {"name": "mode", "kind": "choice", "choices": ["PRODUCTION", "MANUAL"]}
    given = [argument("unit.change_mode", about, text) for text in ("manual", "PRODUCTION", "manuel")]
    assert given == ["MANUAL", "PRODUCTION", "manuel"]  # the machine tells what is none


def test_get_shows_signals_and_tunable_numbers_of_a_run(conveyor: umo.Started) -> None:
    result = run("device", "get", "conveyor", "sorter.length", "sorter.belt.deviation", "sorter.entry")
    assert result.exit_code == 0, said(result)
    paths = [line.split()[0] for line in result.stdout.splitlines()]
    assert paths == ["sorter.length", "sorter.belt.deviation", "sorter.entry"]
    assert "m/s  tunable" in result.stdout


def test_an_action_is_called_with_units_and_waited_for(conveyor: umo.Started) -> None:
    result = run("do", "conveyor", "call", "sorter.push")
    assert (result.exit_code, result.stderr) == (0, "sorter.push: done\n")  # and no progress of the application's
    result = run("do", "conveyor", "call", "sorter.belt.run_at", "speed=200 mm/s", "--for", "0.3")
    assert (result.exit_code, result.stderr) == (0, "sorter.belt.run_at: has begun\nsorter.belt.run_at: released\n")
    assert run("do", "conveyor", "call", "sorter.belt.halt").exit_code == 0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["do", "conveyor", "call", "pusch"], "no action 'pusch' (did you mean 'sorter.push'?)"),
        (
            ["do", "conveyor", "call", "sorter.belt.run_at", "sped=1"],
            "'sped=1' is not one of its arguments (did you mean 'speed'?)",
        ),
        (
            ["do", "conveyor", "call", "sorter.belt.run_at", "speed=3"],
            "sorter.belt.run_at: speed: 3 m/s is outside 0 to 1",
        ),
        (
            ["do", "conveyor", "call", "sorter.belt.run_at", "speed=fast"],
            "sorter.belt.run_at: speed: 'fast' is not a number in m/s",
        ),
        (
            ["do", "conveyor", "call", "sorter.belt.run_at", "speed=3 kg"],
            "sorter.belt.run_at: speed: 'kg' cannot be converted to 'm/s'",
        ),
        (["do", "conveyor", "call", "sorter.belt.run_at"], "the argument speed is missing"),
        (
            ["do", "conveyor", "call", "sorter.belt.run_at", "speed=0", "speed=1"],
            "sorter.belt.run_at: speed is given twice",
        ),
        (["tune", "number", "conveyor", "windows", "3"], "no tunable number 'windows' (did you mean 'sorter.window'?)"),
        (["tune", "number", "conveyor", "sorter.window", "1 m"], "window: 1000 mm is outside 1 to 100"),
        (["tune", "number", "conveyor", "sorter.window", "-0.5"], "window: -0.5 mm is outside 1 to 100"),
        (["tune", "number", "conveyor", "sorter.window", "-5 1/h"], "window: '1/h' cannot be converted to 'mm'"),
        (
            ["device", "set", "conveyor", "sorter.belt.setpoint", "-.5"],
            "sorter.belt.setpoint: -0.5 m/s is outside 0 to 1",
        ),
        (
            ["do", "conveyor", "call", "sorter.belt.run_at", "speed=-3"],
            "sorter.belt.run_at: speed: -3 m/s is outside 0 to 1",
        ),
        (
            ["do", "conveyor", "call", "sorter.push", "--for", "1"],
            "sorter.push ends by itself; --for can only be used with dead-man actions",
        ),
        (
            ["device", "set", "conveyor", "sorter.belt.setpont", "1"],
            "no object 'sorter.belt.setpont' (did you mean 'sorter.belt.setpoint'?)",
        ),
        (["device", "get", "conveyor", "sorter.lenght"], "no object 'sorter.lenght' (did you mean 'sorter.length'?)"),
        (["device", "get", "conveyor", "sorter.push"], "sorter.push is an action: `umo do conveyor call sorter.push`"),
        (
            ["device", "set", "conveyor", "sorter.length", "3"],
            "sorter.length is a number that is only shown and cannot be set",
        ),
        (
            ["device", "set", "conveyor", "sorter.window", "3"],
            "sorter.window is a number: `umo tune number` changes it",
        ),
        (["do", "conveior", "acknowledge"], "no station or device 'conveior' is running or must be acknowledged"),
        (["do", "conveyor", "call", "sorter.belt.run_at", "-3"], "sorter.belt.run_at: speed: -3 m/s is outside 0 to 1"),
        (["do", "conveyor", "call", "sorter.belt.run_at", "1", "2"], "'2' is not one of its arguments: speed=..."),
        (
            ["do", "conveyor", "mode", "automatisch"],
            "there is no mode 'automatisch' (did you mean 'automatic'?); there are: automatic, manual",
        ),
        (["do", "stop"], "stop is a verb; the station comes first: `umo do conveyor stop`"),
        (["do", "mode", "manual"], "mode is a verb; the station comes first: `umo do conveyor mode manual`"),
        (["do", "conveyor", "stop", "--for"], "`umo do --help` shows what it takes"),
        (["do", "convejor", "mode"], "'convejor' is not running (did you mean 'conveyor'?)"),
        (
            ["do", "conveyor", "acknowledge", "sorter.bolt"],
            "there is no object or signal 'sorter.bolt' (did you mean 'sorter.belt'?) in conveyor",
        ),
        (
            ["do", "conveyor", "clear", "*.setpont"],
            "there is no object or signal '*.setpont' (did you mean 'sorter.belt.setpoint'?)",
        ),
        (
            ["device", "set", "conveyor", "sorter.entry", "COVERED"],
            "sorter.entry is a sensor; only actuators can be set",
        ),
    ],
)
def test_a_mistake_is_said_in_a_line_with_status_2(conveyor: umo.Started, words: list[str], text: str) -> None:
    result = run(*words)
    assert (result.exit_code, text in said(result)) == (2, True), said(result)
    assert len(result.stderr.strip().splitlines()) <= 2


BOX, ANOTHER = f"box {os.getpid()}", f"another {os.getpid()}"
"""Devices: they are held beyond this test process."""


@pytest.mark.parametrize("name", ["press", BOX], ids=["station", "device"])
def test_an_unsafe_end_is_acknowledged_without_a_run_by_station_or_device(name: str) -> None:
    DeviceClaim([BOX], "press").stopped("it was killed", [])
    DeviceClaim([ANOTHER], "mill").stopped("it was killed", [])
    result = run("do", name, "acknowledge")
    assert result.exit_code == 0
    assert result.stdout.startswith(f"acknowledged: press, every actuator was reset, {BOX}, ")
    assert [each.device for each in all_standing()] == [ANOTHER]
    assert run("do", name, "acknowledge").exit_code == 2


@pytest.mark.parametrize(
    ("failed", "text"),
    [
        ("umo.clients.remote.RemoteStation.acknowledge", "conveyor has ended"),
        ("umo_command.do.clearing.attach", "2 runs are going on"),
    ],
)
def test_an_unsafe_end_is_not_acknowledged_where_a_station_of_the_name_runs(
    conveyor: umo.Started, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, failed: str, text: str
) -> None:
    def fail(*_: object) -> None:
        DeviceClaim([BOX], "conveyor").stopped("it was killed", [])
        raise umo.errors.FramesError(text)

    monkeypatch.setenv("UMO_STATE", str(tmp_path))
    monkeypatch.setattr(failed, fail)
    assert run("do", "conveyor", "acknowledge").exit_code == 2
    assert [each.device for each in all_standing()] == [BOX]


def test_an_acknowledgement_says_that_nothing_was_latched(conveyor: umo.Started) -> None:
    for words, said_of in (
        (["sorter.belt"], ["sorter.belt"]),
        ([], ["conveyor"]),
        (["sorter.diverter", "*.belt.setpoint"], ["sorter.diverter", "sorter.belt.setpoint"]),
    ):
        result = run("do", "conveyor", "acknowledge", *words)
        assert result.exit_code == 0, said(result)
        assert result.stdout == "".join(f"{each}: nothing was latched\n" for each in said_of)


def test_a_number_is_tuned_and_how_to_keep_it_is_said(conveyor: umo.Started) -> None:
    result = run("tune", "number", "conveyor", "sorter.window", "3.0123456789 cm")
    assert result.exit_code == 0, said(result)
    assert result.stdout == "sorter.window  20 -> 30.123456789 mm\n"
    assert 'put "sorter.window" = 30.123456789 under [parameters] of the wiring simulated' in said(result)
    until(lambda: run("tune", "number", "conveyor", "sorter.window").stdout == "sorter.window  30.123456789 mm\n")
    assert "1 to 100" in run("tune", "number", "conveyor").stdout
    assert tomllib.loads(run("tune", "save", "conveyor").stdout)["parameters"] == {"sorter.window": 30.123456789}
    run("tune", "number", "conveyor", "sorter.window", "30.123456789000002")
    lines = run("tune", "save", "conveyor").stdout
    assert lines.startswith('[parameters]\n"sorter.window" = ')
    assert tomllib.loads(lines)["parameters"] == {"sorter.window": 30.123456789000002}  # as the machine has it
    assert run("tune", "save", "conveyor", "sorter.window").exit_code == 2


def test_an_actuator_of_a_running_station_is_taken_and_given_back(conveyor: umo.Started) -> None:
    result = run("device", "set", "conveyor", "sorter.diverter", "ON", "--for", "0.1")
    assert result.exit_code == 0, said(result)
    assert "sorter.diverter  released: " in result.stdout


def test_an_actuator_with_a_slew_rate_is_on_its_way_when_it_is_held_and_when_it_is_released(
    conveyor: umo.Started,
) -> None:
    held, released = run("device", "set", "conveyor", "sorter.belt.setpoint", "0.5", "--for", "0.1").stdout.splitlines()
    assert "(on its way to 0.50000 m/s: its slew rate is limited)" in held
    assert "(on its way to its default 0.00000 m/s, or written by the program)" in released


@pytest.mark.parametrize("words", HELD)
@pytest.mark.parametrize("how", ["another client takes the lease", "it sends no heartbeat"])
def test_a_command_ends_with_status_2_when_the_machine_holds_no_longer_what_it_holds(
    conveyor: umo.Started, monkeypatch: pytest.MonkeyPatch, words: list[str], how: str
) -> None:
    def take(lease: HeldLease) -> None:
        with umo.attach(conveyor.pid) as station, station.lease("ann", over=True):
            pass

    once_held(monkeypatch, take if how.startswith("another") else lambda lease: setattr(lease, "_ended", True))
    result = run(*words)
    *_, line = result.stderr.splitlines()
    assert (result.exit_code, line.partition(": ")[2].partition(": ")[0]) == (2, f"{words[3]} is no longer held"), line
    assert "released: " not in result.stdout


@pytest.mark.parametrize("words", HELD)
@pytest.mark.parametrize(("hold", "status"), [(["--for", "60"], 130), ([], 0)])
def test_a_ctrl_c_that_cuts_a_hold_short_is_the_exit_status(
    conveyor: umo.Started, monkeypatch: pytest.MonkeyPatch, words: list[str], hold: list[str], status: int
) -> None:
    def interrupt(lease: HeldLease) -> None:
        raise KeyboardInterrupt

    once_held(monkeypatch, interrupt)
    result = run(*words, *hold)
    assert result.exit_code == status, said(result)
    assert "released: " in result.stdout or "released" in result.stderr


@pytest.mark.parametrize(("text", "found"), [("open", "open"), ("OPEN", "open"), ("Shut", "SHUT"), ("Open", "open")])
def test_a_state_is_found_whatever_its_letters(text: str, found: str) -> None:
    assert state("valve", text, ["open", "SHUT"]) == found


def test_a_state_with_the_very_letters_comes_first() -> None:
    assert state("valve", "shut", ["Shut", "shut"]) == "shut"


def test_what_was_never_held_has_not_ended(conveyor: umo.Started) -> None:
    with umo.attach(conveyor.pid) as station, station.lease() as lease:
        assert lease.ended("sorter.diverter") == ""


def test_the_lease_of_another_client_is_shown_and_taken_over_only_on_demand(conveyor: umo.Started) -> None:
    with umo.attach(conveyor.pid) as station, station.lease("somebody else"):
        assert "lease: somebody else" in run("do", "conveyor", "mode").stdout
        result = run("do", "conveyor", "call", "sorter.push")
        text = "umo: somebody else has the lease; take it over with --take, or wait until it is given back"
        assert (result.exit_code, said(result)) == (2, text)
        assert run("do", "conveyor", "call", "sorter.push", "--take").exit_code == 0
    events = [event for event in umo.attach(conveyor.pid).events if event.who.endswith("else")]
    assert json.dumps([event.asked for event in events][:1]) == '["lease"]'


def test_ps_and_watch_show_the_mode_and_who_has_the_lease(conveyor: umo.Started) -> None:
    def lines() -> Any:
        (line,) = json.loads(run("show", "stations", "--json").stdout)["running"]
        return line["mode"], line["lease"]

    assert lines() == ("manual", None)
    assert "manual" in run("show", "stations").stdout
    assert "lease" not in run("show", "stations").stdout
    with umo.attach(conveyor.pid) as station, station.lease("some\x1bbody"):
        assert lines() == ("manual", "some?body")
        assert "some?body" in run("show", "stations").stdout
        assert "mode: manual · lease: some?body · " in run("show", "values", "conveyor", "--once").stdout
        assert "lease: some?body" in run("do", "conveyor", "mode").stdout


@pytest.mark.full
def test_the_command_that_runs_a_station_tells_who_has_stopped_it(tmp_path: Path) -> None:
    def stop() -> None:
        until(readers)
        with umo.attach("conveyor") as station:
            station.stop("ann, the page\x1b[2J")

    stopping = threading.Thread(target=stop)
    stopping.start()
    result = run("run", "conveyor", "-w", str(patient.conveyor(tmp_path)), "--manual", "--no-record")
    stopping.join()
    assert result.exit_code == 128 + signal.SIGTERM
    assert "umo: stopped by ann, the page?[2J; every actuator is at its default" in said(result)


def test_a_station_is_stopped_and_a_command_that_holds_something_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[Result] = []
    once_held(monkeypatch, lambda lease: stopped.append(run("do", "conveyor", "stop")))
    with umo.start("conveyor", patient.conveyor(tmp_path), manual=True, realtime=True) as started:
        until(lambda: started.poll(0.01) or (started.frames is not None and started.frames.head > 5))
        result = run(*HELD[0])
        assert said(result).endswith("umo: sorter.diverter is no longer held: conveyor has ended")
        assert result.exit_code == 2
        (result,) = stopped
        assert result.exit_code == 0, said(result)
        assert re.fullmatch(r"conveyor has ended: stopped by \w+, umo do conveyor stop \(pid \d+\)\n", result.stdout)
        assert started.wait(20).failure is None


def test_a_clear_says_how_to_go_on_with_a_unit_that_stays_stopped(tmp_path: Path) -> None:
    with umo.start("conveyor", patient.conveyor(tmp_path), realtime=True) as started:
        until(lambda: started.poll(0.01) or (started.frames is not None and started.frames.head > 5))
        assert run("do", "conveyor", "call", "sorter.unit.abort").exit_code == 0
        with umo.attach("conveyor") as station:
            until(lambda: "sorter" in station.faults)
        assert run("do", "conveyor", "clear").stdout.splitlines() == [
            "cleared: sorter",
            "sorter.unit is stopped: go on with `umo do conveyor call sorter.unit.reset`, then `umo do conveyor call "
            "sorter.unit.start`",
        ]
        assert run("do", "conveyor", "clear").stdout == "nothing was in fault\n"
