"""`umo tune law`: on four processes whose models are known, on a station that runs, and what it refuses."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import umo
from helpers import lagging, patient
from helpers.few_kinds import few_kinds
from helpers.tiers import first
from helpers.true_margins import true_margins
from helpers.waiting import until
from umo.commissioning.tuning.law_facts import LawFacts
from umo.commissioning.tuning.live_experiment import moves
from umo.commissioning.tuning.margins import Gains, margins
from umo.commissioning.tuning.models import ProcessModel
from umo.errors import RangeError
from umo.objects.quality import Quality
from umo.process.start import LINUX
from umo_command.app import app

pytest.importorskip("scipy")
realtime = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")
RARER = [signal.SIGINT, signal.SIGTERM, signal.SIGSTOP]
FURNACE_PERIOD = 0.1
SETTINGS = ("gain", "integral_time", "derivative_time", "filter_time")


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lagging.station(tmp_path_factory.mktemp("stations"))


@pytest.fixture
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    few_kinds(monkeypatch)


def invoke(*words: object) -> Result:
    return CliRunner().invoke(app, list(map(str, words)))


def found(*words: object) -> dict[str, Any]:
    result = invoke("tune", "law", *words, "--json")
    assert result.exit_code == 0, result.output
    data: dict[str, Any] = json.loads(result.stdout)
    return data


def balanced(data: dict[str, Any]) -> Gains:
    (chosen,) = (each for each in data["sets"] if each["name"] == "balanced")
    return Gains(**{name: chosen[name] for name in SETTINGS if chosen[name] is not None})


def model_of(data: dict[str, Any]) -> ProcessModel:
    found = {letter: each["value"] for letter, each in data["model"]["parameters"].items()}
    lags = tuple(found[letter] for letter in ("T", "T1", "T2") if letter in found)
    return ProcessModel(data["model"]["kind"], found["K"], found["L"], lags)


@pytest.mark.full
@pytest.mark.parametrize("kind", first(1, ["--step", "--relay"]))
@pytest.mark.parametrize("process", first(1, lagging.MODELS))
def test_balanced_gains_have_their_margins_on_the_true_process(tank: Path, process: str, kind: str) -> None:
    data = found(tank, "servo", kind, "10%", "--at", "2", "--for", "40", "--within", "80", "--process", process)
    gain, phase = true_margins(lagging.MODELS[process], balanced(data), lagging.PERIOD)
    assert gain >= 2.0
    assert phase >= 45.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", first(1, ["--relay", "--step"]))
@pytest.mark.full
def test_a_zone_of_the_furnace_is_tuned(kind: str) -> None:
    furnace = ("--zones", "4", "--peak", "150", "--soak", "900", "--ramp", "4")
    data = found("furnace", "zones.1", kind, "5%", "--at", "120", "--within", "150", *furnace)
    assert (data["law"], data["actuator"]) == ("heating.1", "zones.1.heater")
    sets = {each["name"]: each for each in data["sets"]}
    gain, phase = true_margins(model_of(data), balanced(data), FURNACE_PERIOD)
    assert gain >= 2.0
    assert phase >= 45.0
    assert 1.0 < sets["cautious"]["gain"] <= sets["balanced"]["gain"] < sets["quick"]["gain"] < 20.0


@pytest.mark.usefixtures("simple")
def test_the_lines_to_try_and_to_keep_are_printed_and_the_plot_drawn(tank: Path, tmp_path: Path) -> None:
    picture = tmp_path / "tuned.png"
    result = invoke(
        "tune", "law", tank, "valve", "--step", "5 percent", "--at", "2", "--gains", "quick", "--out", picture
    )
    assert result.exit_code == 0, result.output
    lines = [line.strip() for line in result.stdout.splitlines()]
    (tried,) = (line for line in lines if line.startswith("umo tune number ") and "servo.gain" in line)
    (kept,) = (line for line in lines if line.startswith('"servo.gain" = '))
    assert tried.split()[-1] == kept.split()[-1]
    assert any(line.startswith("quick") for line in lines)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("simple")
def test_a_trace_gives_the_gains_without_an_experiment(tank: Path, tmp_path: Path) -> None:
    rows = ["time_s,missed,execution_us,valve[percent],level[mm]"]
    level, waiting = 150.0, [30.0] * 10
    for number in range(1000):
        valve = 30.0 if number < 200 else 40.0
        rows.append(f"{number * 0.01:.2f},0,1,{valve},{level:.2f}")
        waiting.append(valve)
        level += (5.0 * waiting.pop(0) - level) * 0.01 / 2.0
    trace = tmp_path / "trace.csv"
    trace.write_text("\n".join(rows))
    data = found(tank, "servo", "--file", trace)
    parameters = {letter: each["value"] for letter, each in data["model"]["parameters"].items()}
    assert parameters == pytest.approx({"K": 5.0, "T": 2.0, "L": 0.1}, rel=0.02)
    assert [each["name"] for each in data["sets"]] == ["present", "cautious", "balanced", "quick"]
    assert all(each["gain_margin"] >= least for each, least in zip(data["sets"], (1.0, 3.0, 2.0, 1.6), strict=True))
    still = invoke("tune", "law", tank, "servo", "--file", trace, "--to", "1.9")
    assert still.exit_code == 2
    assert "valve moved by only" in still.output


def following_error(folder: Path) -> float:
    """Of the z axis after homing, root of the mean square, um."""
    (trace,) = folder.glob("runs/*/trace.csv")
    with trace.open() as lines:
        rows = [row for row in csv.DictReader(lines) if float(row["time_s"]) > 6.0 and row["z.setpoint[um]"] != "nan"]
    return float(np.sqrt(np.mean([float(row["z.error[um]"]) ** 2 for row in rows])))


@pytest.mark.parametrize(("actions", "home"), [(("z.home", "home"), "home"), (("z.home",), "z.home")])
def test_an_axis_that_is_not_referenced_is_refused_with_the_command_that_homes_it(
    actions: tuple[str, ...], home: str
) -> None:
    class Unreferenced(dict[str, Any]):
        reader = SimpleNamespace(
            layout=SimpleNamespace(actions=[{"path": each} for each in actions]), about={"station": "arm"}
        )

    station: Any = Unreferenced({"z.encoder": SimpleNamespace(quality=Quality.UNREFERENCED)})
    facts = LawFacts("z.servo", "z.encoder", "z.motor", Gains(1.0), 0.001, axis=True)
    with pytest.raises(RangeError) as refused:
        moves(station, facts, 1.0)
    assert str(refused.value) == f"z is not referenced: `umo do arm call {home}` first"


@pytest.mark.full
def test_an_axis_is_tuned_from_its_moves_with_feed_forward_and_friction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    before, after = tmp_path / "before", tmp_path / "after"
    before.mkdir(), after.mkdir()
    monkeypatch.chdir(before)
    assert invoke("run", "ztheta", "--parts", "1", "--no-plot").exit_code == 0
    (trace,) = before.glob("runs/*/trace.csv")
    data = found("ztheta", "z", "--file", trace, "--from", "6")
    axis = data["axis"]
    assert axis["feed_forward"] == pytest.approx(3.1416e-5, rel=0.02)  # as docs/ztheta.md measured it
    assert axis["inertia"] == pytest.approx(2.25e-7, rel=0.15)
    assert axis["friction"] == pytest.approx(0.0955, rel=0.2)
    assert data["sets"][2]["gain_margin"] >= 2.0
    printed = invoke("tune", "law", "ztheta", "z", "--file", trace, "--from", "6").stdout
    parameters = printed[printed.index("[parameters]") :]
    assert '"z.feed_forward" = ' in parameters
    assert "  umo tune number ztheta z.servo.gain " in printed
    wiring = patient.patient("ztheta", after)
    wiring.write_text(f"{wiring.read_text()}\n{parameters}")
    monkeypatch.chdir(after)
    assert invoke("run", "ztheta", "-w", wiring, "--parts", "1", "--no-plot").exit_code == 0
    assert following_error(after) < 0.5 * following_error(before)


def test_without_a_law_the_laws_are_listed() -> None:
    assert invoke("tune", "law", "furnace").stdout == "heating[0..39]\n"
    assert invoke("tune", "law", "furnace", "--zones", "2").stdout == "heating[0..1]\n"


@pytest.mark.usefixtures("simple")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["servo"], "give one of --relay, --step, --moves, --file"),
        (["servo", "--relay", "10%", "--step", "10%"], "not --relay and --step"),
        (["servo", "--relay", "10%"], "does not run"),
        (["srevo", "--relay", "10%", "--at", "1"], "no law 'srevo' (did you mean 'servo'?)"),
        (["servo", "--relay", "10 K", "--at", "1"], "--relay"),
        (["servo", "--relay", "60%", "--at", "1"], "at most a relay of "),
        (["servo", "--step", "10 parsec", "--at", "1"], "a share of the range of valve is possible too, such as 10%"),
        (["servo", "--relay", "-10%", "--at", "1"], "amplitude"),
        (["servo", "--relay", "10%", "--at", "1", "--within", "0.01"], "(`--within` sets this)"),
        (["servo", "--step", "10%", "--at", "9", "--lasts", "5"], "the application ended before"),
        (["servo", "--moves", "10 mm"], "does not run"),
        (["servo", "--file", "none.csv"], "there is no such file"),
        (["servo", "--relay", "10%", "--gains", "wild"], "there is no set 'wild'"),
        (["servo", "--relay", "10%", "--from", "1"], "used with --file"),
        (["servo", "--relay", "10%", "--at", "1", "--out", "x.pdf"], "a plot is a .png"),
        (["servo", "--relay", "10%", "--at", "1", "--sensor", "valve.x"], "no sensor 'valve.x'"),
    ],
)
def test_mistakes_are_told_in_a_line(tank: Path, words: list[str], message: str) -> None:
    result = invoke("tune", "law", tank, *words)
    assert result.exit_code in (1, 2)
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    "content", ["", "a,b\n1,2\n", "time_s,valve[percent]\n1,2\n", "\xff\xfe\x00", "time_s,valve,level\n1,x,2\n"]
)
def test_wrong_files_are_refused(tank: Path, tmp_path: Path, content: str) -> None:
    file = tmp_path / "wrong.csv"
    file.write_bytes(content.encode("latin-1"))
    result = invoke("tune", "law", tank, "servo", "--file", file)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


# A station that runs ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def started(tank: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """One for all tests, in manual mode; its frames and records are in folders of its own."""
    folders = {name: str(tmp_path_factory.mktemp(name.lower())) for name in ("UMO_FRAMES", "UMO_STATE")}
    with pytest.MonkeyPatch.context() as patch:
        for name, folder in folders.items():
            patch.setenv(name, folder)
        with umo.start(str(tank), manual=True, realtime=True) as run:
            until(lambda: run.poll(0.01) or (run.frames is not None and run.frames.head > 5))
            yield folders


@pytest.fixture
def running(started: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Iterator[umo.clients.remote.RemoteStation]:
    for name, folder in started.items():
        monkeypatch.setenv(name, folder)
    with umo.attach("tank") as station:
        yield station


@realtime
@pytest.mark.slow
@pytest.mark.usefixtures("simple")
def test_a_running_station_is_tuned_through_the_lease(running: Any) -> None:
    data = found("tank", "servo", "--relay", "10%", "--cycles", "3")
    true = margins(lagging.MODELS["lag"], balanced(data), lagging.PERIOD)  # as python-control: test_tuning_rules.py
    assert true.gain >= 2.0
    assert true.phase >= 45.0
    assert running.valve.read() == pytest.approx(30.0, abs=5.0)
    with running.lease("somebody else"):
        refused = invoke("tune", "law", "tank", "servo", "--relay", "10%")
    assert refused.exit_code == 2
    assert "somebody else has the lease" in refused.output


@realtime
@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [signal.SIGKILL, *(pytest.param(each, marks=pytest.mark.full) for each in RARER)],
)
def test_a_killed_client_leaves_the_old_output_and_the_law_in_control(running: Any, number: int) -> None:
    command = [sys.executable, "-m", "umo_command", "tune", "law", "tank", "servo", "--step", "20%", "--within", "500"]
    client = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ)
    try:
        until(lambda: running.valve.read() > 45.0)
        client.send_signal(number)
        until(lambda: running.valve.read() < 40.0)
        until(lambda: abs(running.level.read() - 150.0) < 5.0 and abs(running.valve.read() - 30.0) < 2.0)
    finally:
        client.kill()
        client.wait(10)
    until(lambda: not running.reader.now().holder)


@realtime
@pytest.mark.slow
def test_automatic_mode_is_refused_with_the_way_out(running: Any) -> None:
    with running.lease("a test"):
        running.mode = "automatic"
    try:
        result = invoke("tune", "law", "tank", "servo", "--relay", "10%")
        assert result.exit_code == 2
        assert "manual mode only" in result.output
    finally:
        with running.lease("a test"):
            running.mode = "manual"
    until(lambda: running.mode == "manual")
