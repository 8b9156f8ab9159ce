"""The report of a driver at the end of a run: whatever it is, the run ends as it would without it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalSensor, connect
from umo.cycle.trace import Statistics
from umo.drivers import Reports
from umo.errors import DeviceTimeout
from umo.process.outcome import Outcome, plain_reports
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods
from umo_command.run.run_folder import RunSummary


class Lamp(Compound):
    lamp: BinaryActuator[OnOff]
    timer: DigitalSensor


class Hostile:
    def __repr__(self) -> str:
        raise RuntimeError("no text")


def raising(error: BaseException) -> Callable[[], Any]:
    def report() -> Any:
        raise error

    return report


def holding_itself() -> Any:
    found: dict[str, Any] = {}
    found["self"] = found
    return found


REPORTS: dict[str, Callable[[], Any]] = {
    "OSError": raising(OSError("unplugged")),
    "DeviceTimeout": raising(DeviceTimeout("no answer")),
    "RuntimeError": raising(RuntimeError("a mistake")),
    "SystemExit": raising(SystemExit("no report")),
    "None": lambda: None,
    "number": lambda: 5,
    "hostile": lambda: {"value": Hostile(), "level": 3},
    "keys": lambda: {(1, 2): float("nan"), None: float("inf"), b"x": {1, 2}},
    "itself": holding_itself,
    "letters": lambda: {"\udcff\x1b[31m": "\udcff\x00", "long": "x" * 100_000, "deep": [[[[]]]] * 100},
}


@pytest.mark.parametrize("name", first(5, sorted(REPORTS)))
def test_a_report_of_any_kind_fails_neither_the_run_nor_its_summary_and_table(name: str, tmp_path: Path) -> None:
    class Reporting(Scripted, Reports):
        def report(self) -> Any:
            return REPORTS[name]()

    machine = Lamp(
        lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False),
    )
    box = Reporting()
    wire = {"lamp": {"driver": "box"}, "timer": {"driver": "clock", "period": "10 ms"}}
    connection = connect(machine, {"drivers": {"box": box, "clock": VirtualTimer()}, "wire": wire})
    with connection as m:
        periods(m, 2)
    summary = RunSummary(Statistics(), Outcome(reports=plain_reports(connection.reports), driven=True))
    assert summary.outcome.status == 0
    summary.save(tmp_path / "summary.json")
    assert "box" in json.loads((tmp_path / "summary.json").read_text())["reports"]
    console = Console(width=100, record=True)
    console.print(summary.table("umo run"))
    assert "box" in console.export_text()
