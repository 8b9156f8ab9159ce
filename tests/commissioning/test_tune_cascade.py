"""`umo tune law` on the outer law of a cascade, whose processes are known; its margins are those of python-control."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

import umo
from helpers import cascaded
from helpers.few_kinds import few_kinds
from helpers.tiers import first
from helpers.true_margins import true_cascade_margins
from helpers.waiting import until
from umo.commissioning.tuning.margins import Gains
from umo.commissioning.tuning.models import ProcessModel
from umo.commissioning.tuning.tried_gains import trying
from umo.process.start import LINUX
from umo_command.app import app

pytest.importorskip("scipy")
realtime = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")
SETTINGS = ("gain", "integral_time", "derivative_time", "filter_time")
INNER = ProcessModel("first order", cascaded.INNER_GAIN, 0.0, (cascaded.INNER_LAG,))
PRESENT = Gains(cascaded.GAIN, cascaded.INTEGRAL_TIME)
"""Of the inner law."""


@pytest.fixture(scope="module")
def reactor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cascaded.station(tmp_path_factory.mktemp("stations"))


@pytest.fixture
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    few_kinds(monkeypatch)


def invoke(*words: object) -> Result:
    return CliRunner().invoke(app, ["tune", "law", *map(str, words)])


def found(*words: object) -> Any:
    result = invoke(*words, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def balanced(data: dict[str, Any]) -> Gains:
    (chosen,) = (each for each in data["sets"] if each["name"] == "balanced")
    return Gains(**{name: chosen[name] for name in SETTINGS if chosen[name] is not None})


@pytest.mark.parametrize("kind", first(1, ["--relay", "--step"]))
@pytest.mark.parametrize("process", first(1, cascaded.OUTER))
@pytest.mark.full
def test_balanced_gains_have_their_margins_around_the_true_inner_loop(reactor: Path, process: str, kind: str) -> None:
    data = found(reactor, "vessel_law", kind, "10%", "--at", "2", "--within", "40", "--process", process)
    assert (data["sensor"], data["actuator"]) == ("vessel", "jacket_law.setpoint")
    gain, phase = true_cascade_margins(cascaded.OUTER[process], balanced(data), INNER, PRESENT, cascaded.PERIOD)
    assert gain >= 2.0
    assert phase >= 45.0


@pytest.mark.full
def test_an_inner_loop_that_is_too_slow_is_told(reactor: Path) -> None:
    words = (reactor, "vessel_law", "--step", "10%", "--at", "2", "--within", "40", "--process")
    quick = invoke(*words, "vessel")
    assert "times faster" in quick.stdout
    assert "the inner law, is only" not in quick.output
    slow = invoke(*words, "near", "--wiring", "slow")
    assert slow.exit_code == 0, slow.output
    assert "jacket_law, the inner law, is only" in " ".join(slow.output.split())


@pytest.mark.full
def test_an_inner_law_at_its_limit_is_told(reactor: Path) -> None:
    words = (reactor, "vessel_law", "--relay", "10%", "--at", "2", "--within", "80")
    assert "at its limit" not in invoke(*words).output
    limited = invoke(*words, "--wiring", "limited")
    assert limited.exit_code == 2, limited.output
    assert "jacket_law, the inner law, was at its limit during" in " ".join(limited.output.split())
    assert "no linear model describes the response" in " ".join(limited.output.split())


@pytest.mark.full
@pytest.mark.parametrize("process", first(1, cascaded.OUTER))
def test_both_laws_are_tuned_and_the_outer_one_with_the_new_inner_gains(reactor: Path, process: str) -> None:
    words = (reactor, "vessel_law", "--cascade", "--relay", "0.5%", "--at", "2", "--within", "40", "--process", process)
    data = found(*words)
    inner, outer = data["inner"], data["outer"]
    assert (inner["law"], outer["law"]) == ("jacket_law", "vessel_law")
    tried = Gains(**{name: inner["chosen"][name] for name in ("gain", "integral_time")})
    gain, phase = true_cascade_margins(cascaded.OUTER[process], balanced(outer), INNER, tried, cascaded.PERIOD)
    assert gain >= 2.0
    assert phase >= 45.0
    assert tried.gain > 2.0 * cascaded.GAIN
    assert outer["inner"]["time"] < 0.15


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["jacket_law", "--relay", "5%", "--at", "1"], "jacket_law has no inner law; a `Cascade` has one"),
        (["vessel_law", "--file", "trace.csv"], "--cascade can only be used with --relay or --step"),
        (["vessel_law", "--step", "5 K", "--at", "1"], "the amplitude must be a share of the range"),
        (["vessel_law", "--step", "5%", "--at", "1", "--sensor", "vessel"], "finds the sensors and actuators"),
        (["vessel_law", "--step", "5%"], "does not run"),
    ],
)
def test_mistakes_with_a_cascade_are_told_in_a_line(reactor: Path, words: list[str], message: str) -> None:
    result = invoke(reactor, *words, "--cascade")
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output


# A station that runs ---------------------------------------------------------------------------------------


@pytest.fixture
def running(reactor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[umo.RemoteStation]:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    with umo.start(str(reactor), manual=True, realtime=True) as run:
        until(lambda: run.poll(0.01) or (run.frames is not None and run.frames.head > 5))
        with umo.attach("reactor") as station:
            yield station


@realtime
@pytest.mark.slow
@pytest.mark.full
def test_both_laws_of_a_running_station_are_tuned_and_the_old_gains_are_back(running: Any) -> None:
    data = found("reactor", "vessel_law", "--cascade", "--relay", "1%", "--cycles", "3", "--within", "40")
    assert data["inner"]["chosen"]["gain"] > 2.0
    assert data["outer"]["sets"][2]["gain_margin"] >= 2.0
    assert running.tuned == {}
    with pytest.raises(RuntimeError), running.lease("a test"), trying(running, "jacket_law", {"gain": 2.5}):
        until(lambda: running.tuned == {"jacket_law.gain": 2.5})
        raise RuntimeError
    until(lambda: running.tuned == {})
    assert running["jacket_law.setpoint"] == pytest.approx(50.0, abs=2.0)


@realtime
@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_client_leaves_the_old_setpoint_and_both_laws_in_control(running: Any, number: int) -> None:
    words = ["tune", "law", "reactor", "vessel_law", "--step", "20%", "--within", "100"]
    command = [sys.executable, "-m", "umo_command", *words]
    client = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ)
    try:
        until(lambda: running["jacket_law.setpoint"] > 70.0)
        client.send_signal(number)
        until(lambda: running["jacket_law.setpoint"] < 60.0)
        until(lambda: abs(running.vessel.read() - 40.0) < 1.0)
    finally:
        client.kill()
        client.wait(10)
    until(lambda: not running.reader.now().holder)


PLAIN = (
    ("import Cascade, Servo", "import PID, Servo, value_of"),
    (
        "Cascade(self.vessel, self.jacket_law, low=0.0, high=150.0, gain=0.5, integral_time=8.0)",
        "PID(gain=0.5, integral_time=8.0)",
    ),
    (
        "self.vessel_law.control(self.target, dt=self.dt)",
        "wanted = self.vessel_law.step(self.target, value_of(self.vessel), self.dt, low=0.0, high=150.0)\n"
        "        self.jacket_law.control(wanted, dt=self.dt)",
    ),
)
"""From the cascade to two laws that the machine's code connects."""


@pytest.mark.usefixtures("simple")
def test_two_laws_on_numbers_are_tuned_where_the_paths_are_given(tmp_path: Path) -> None:
    place = cascaded.station(tmp_path)
    text = (place / "objects.py").read_text()
    for one, other in PLAIN:
        assert one in text
        text = text.replace(one, other)
    (place / "objects.py").write_text(text)
    words = (place, "vessel_law", "--step", "10 K", "--at", "2", "--within", "40")
    refused = invoke(*words)
    assert refused.exit_code == 2
    assert "does not name its sensor: give --sensor" in refused.output
    data = found(*words, "--sensor", "vessel", "--actuator", "jacket_law.setpoint")
    assert data["model"]["parameters"]["K"]["value"] == pytest.approx(0.8, rel=0.02)


@pytest.mark.usefixtures("simple")
def test_a_trace_of_a_run_gives_the_gains_of_the_outer_law(reactor: Path, tmp_path: Path) -> None:
    rows = ["time_s,missed,execution_us,heater[percent],jacket[degC],vessel[degC],jacket_law.setpoint[degC]"]
    jacket, vessel, waiting = 50.0, 40.0, [50.0] * 10
    for number in range(1000):
        setpoint = 50.0 if number < 200 else 60.0
        rows.append(f"{number * 0.02:.2f},0,1,25,{jacket:.3f},{vessel:.3f},{setpoint}")
        waiting.append(jacket)
        vessel += (0.8 * waiting.pop(0) - vessel) * 0.02 / 6.0
        jacket += (setpoint - jacket) * 0.02 / 0.3
    trace = tmp_path / "trace.csv"
    trace.write_text("\n".join(rows))
    data = found(reactor, "vessel_law", "--file", trace)
    parameters = {letter: each["value"] for letter, each in data["model"]["parameters"].items()}
    assert parameters == pytest.approx({"K": 0.8, "T1": 6.0, "T2": 0.3, "L": 0.2}, rel=0.1)
    assert data["inner"]["law"] == "jacket_law"
    assert data["inner"]["time"] == pytest.approx(0.3, rel=0.1)
