"""`umo tune-law` on the outer law of a cascade, whose processes are known; its margins are those of python-control."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from helpers import cascaded
from helpers.true_margins import true_cascade_margins
from umo.cli.app import app
from umo.tuning.margins import Gains
from umo.tuning.models import ProcessModel

pytest.importorskip("scipy")
pytest.importorskip("control")
SETTINGS = ("gain", "integral_time", "derivative_time", "filter_time")
INNER = ProcessModel("first order", cascaded.INNER_GAIN, 0.0, (cascaded.INNER_LAG,))
PRESENT = Gains(cascaded.GAIN, cascaded.INTEGRAL_TIME)
"""Of the inner law."""


@pytest.fixture(scope="module")
def reactor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cascaded.station(tmp_path_factory.mktemp("stations"))


def invoke(*words: object) -> Result:
    return CliRunner().invoke(app, ["tune-law", *map(str, words)])


def found(*words: object) -> Any:
    result = invoke(*words, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def balanced(data: dict[str, Any]) -> Gains:
    (chosen,) = (each for each in data["sets"] if each["name"] == "balanced")
    return Gains(**{name: chosen[name] for name in SETTINGS if chosen[name] is not None})


@pytest.mark.parametrize("kind", ["--relay", "--step"])
@pytest.mark.parametrize("process", cascaded.OUTER)
def test_balanced_gains_have_their_margins_around_the_true_inner_loop(reactor: Path, process: str, kind: str) -> None:
    data = found(reactor, "vessel_law", kind, "10%", "--at", "2", "--within", "40", "--process", process)
    assert (data["sensor"], data["actuator"]) == ("vessel", "jacket_law.setpoint")
    gain, phase = true_cascade_margins(cascaded.OUTER[process], balanced(data), INNER, PRESENT, cascaded.PERIOD)
    assert gain >= 2.0
    assert phase >= 45.0


def test_an_inner_loop_that_is_too_slow_is_told(reactor: Path) -> None:
    words = (reactor, "vessel_law", "--step", "10%", "--at", "2", "--within", "40", "--process")
    quick = invoke(*words, "vessel")
    assert "times faster" in quick.stdout
    assert "the inner law, is only" not in quick.output
    slow = invoke(*words, "near", "--wiring", "slow")
    assert slow.exit_code == 0, slow.output
    assert "jacket_law, the inner law, is only" in " ".join(slow.output.split())


def test_a_trace_of_a_run_gives_the_gains_of_the_outer_law(reactor: Path, tmp_path: Path) -> None:
    rows = ["time_s,missed,execution_us,heater[percent],jacket[degC],vessel[degC],jacket_law.setpoint[degC]"]
    jacket, vessel, waiting = 50.0, 40.0, [50.0] * 10
    for number in range(2000):
        setpoint = 50.0 if number < 200 else 60.0
        rows.append(f"{number * 0.02:.2f},0,1,25,{jacket:.3f},{vessel:.3f},{setpoint}")
        waiting.append(jacket)
        vessel += (0.8 * waiting.pop(0) - vessel) * 0.02 / 6.0
        jacket += (setpoint - jacket) * 0.02 / 0.3
    trace = tmp_path / "trace.csv"
    trace.write_text("\n".join(rows))
    data = found(reactor, "vessel_law", "--from", trace)
    parameters = {letter: each["value"] for letter, each in data["model"]["parameters"].items()}
    assert parameters == pytest.approx({"K": 0.8, "T1": 6.0, "T2": 0.3, "L": 0.2}, rel=0.1)
    assert data["inner"]["law"] == "jacket_law"
    assert data["inner"]["time"] == pytest.approx(0.3, rel=0.1)
