"""The result of a run that its application has not brought to an end: what it has told of it so far."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import Result

import umo
from helpers.waiting import until
from umo import Compound, DigitalSensor
from umo.control import next_period
from umo.objects.presentation.run_facts import since
from umo.process.frames import run_reader
from umo.process.frames.reader import Reader

Umo = Callable[..., Result]
OBJECTS = """
from umo import Compound, DigitalSensor
class Line(Compound):
    timer: DigitalSensor
def machine():
    return Line(timer=DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False))
"""
APPLICATION = """
from umo.control import next_period
async def main(m, fail: bool = False, most: int = 1000):
    made = {"bottles": 0}
    m.cycle.result(made)
    for _ in range(most):
        await next_period()
        made["bottles"] += 1
        if fail and made["bottles"] == 20:
            raise ValueError("a bottle broke")
    return {"bottles": "all"}
"""


@pytest.fixture
def line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "line"
    folder.mkdir()
    (folder / "objects.py").write_text(OBJECTS)
    (folder / "application.py").write_text(APPLICATION)
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.mark.parametrize(
    ("words", "bottles"), [(["--until", "0.5"], 499), (["--fail"], 20), (["--most", "5"], "all")], ids=str
)
def test_it_is_in_the_table_and_the_summary_however_a_run_ends(
    request: pytest.FixtureRequest, line: Path, words: list[str], bottles: object
) -> None:
    command: Umo = request.getfixturevalue("umo")
    done = command("run", str(line), "--no-plot", "--summary", "summary.json", *words)
    told = json.loads(Path("summary.json").read_text())["result"]
    assert told["bottles"] == bottles or told["bottles"] in (500, 501), done.output
    assert f"bottles │ {told['bottles']}" in " ".join(done.stdout.split()), done.stdout


def test_a_line_that_an_operator_stops_has_its_report(line: Path) -> None:
    """In real time, in processes of its own."""
    with umo.start("conveyor", realtime=True) as started:
        until(lambda: started.poll(0.01) or (started.frames is not None and started.frames.head > 20))
        started.ask_to_stop(2)
        outcome = started.wait(30)
    assert outcome.stopped_by == 2 and outcome.result == {"accepted": 0, "rejected": 0, "lengths_mm": []}


class Line(Compound):
    timer: DigitalSensor


def machine() -> Line:
    return Line(timer=DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False))


def run(told: Any, returned: Any = None) -> Any:
    async def main(m: Line) -> Any:
        m.cycle.result({"earlier": True})
        m.cycle.result(told)
        await next_period()
        return returned

    return umo.run(machine(), application=main)


def test_what_the_application_returns_goes_first_and_the_last_told_counts() -> None:
    assert run({"a": 1}) == {"a": 1}
    assert run({"a": 1}, {"b": 2}) == {"b": 2}
    assert run(lambda: {"a": 1 + 1}) == {"a": 2}
    assert run(None) is None


def test_a_function_that_fails_is_told_in_its_place() -> None:
    def broken() -> Any:
        raise LookupError("no such shift")

    def ending() -> Any:
        raise SystemExit(3)

    assert run(broken).startswith("no result so far: LookupError: no such shift")
    assert "SystemExit" in run(ending)


def test_how_long_a_run_has_lasted_does_not_follow_the_wall_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer without a clock chip is a day off until it asks the network."""
    now = [5_000_000_000]
    monkeypatch.setattr(run_reader.time, "monotonic_ns", lambda: now[0])
    about: dict[str, Any] = {"started": 1.7e9 + 86_400.0, "started_monotonic": 2_000_000_000}
    lasted = Reader.lasted.fget  # type: ignore[attr-defined]
    assert lasted(SimpleNamespace(about=about)) == 3.0
    assert since(about["started"], 3.0).endswith(" (3 s)")
    assert lasted(SimpleNamespace(about=about | {"site": "cell7"})) is None
    assert lasted(SimpleNamespace(about=about | {"started_monotonic": 6_000_000_000})) is None
    assert "(" not in since(about["started"], None)
