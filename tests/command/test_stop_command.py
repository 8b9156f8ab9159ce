"""`umo do STATION stop` says whether the actuators are at their defaults, also where a device does not answer."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.runs import Run
from umo_command.do import stop_run

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of a run need Linux")


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_run, "PATIENCE", 0.0)


def run_whose_valve_fails(tmp_path: Path, **process: Any) -> Run:
    fault = {"type": "helpers.process_box:Faulty", "fault": "reset.valve:raise"}
    return Run(process_box.wiring(tmp_path / "box", **fault, process=process), "forever").until_running()


def test_an_actuator_that_is_not_reached_is_named_with_status_3(umo: Any, tmp_path: Path) -> None:
    run = run_whose_valve_fails(tmp_path, reset_for="50 ms")
    stopped = umo("do", str(run.control), "stop")
    assert stopped.exit_code == 3
    assert "not reached: valve" in " ".join(stopped.stderr.split())
    assert "inspect the machine" in stopped.stderr
    assert run.outcome().status == 3  # it had ended, or the command would have said so too early


def test_it_waits_until_a_device_that_comes_back_has_been_reset(
    umo: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, told = run_whose_valve_fails(tmp_path), []

    def repaired(text: str) -> None:
        told.append((text, umo("show", "stations").stdout))
        (tmp_path / "box.repaired").touch()

    monkeypatch.setattr(stop_run, "say", repaired)
    stopped = umo("do", str(run.control), "stop")
    assert (stopped.exit_code, run.outcome().unreached) == (0, [])
    ((text, stations),) = told
    assert f"its devices are still in use: file {tmp_path / 'box'}; this command waits until they are released" in text
    assert f"file {tmp_path / 'box'} is used by pid {run.control} of " in " ".join(stations.split())


def test_a_run_is_stopped_although_its_records_cannot_be_read(
    umo: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()

    def unreadable(about: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(stop_run, "left_by", unreadable)
    stopped = umo("do", str(run.control), "stop")
    assert (stopped.exit_code, run.outcome().unreached) == (3, [])
    assert "not known whether its actuators are at their defaults: permission denied" in " ".join(
        stopped.stderr.split()
    )
