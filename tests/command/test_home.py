"""`umo` alone: what runs here, and the next steps."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import Result

from umo.system.device_record import Ended
from umo_command.home import next_steps
from umo_command.show import stations

Umo = Callable[..., Result]


def run(name: str, *, alarms: int = 0, faults: dict[str, str] | None = None) -> Any:
    return SimpleNamespace(
        about={"station": name}, latest=lambda: None, alarms=lambda frame: [None] * alarms, faults=lambda frame: faults
    )


def commands(folder: Path, found: list[Any], stopped: list[Any] | None = None) -> list[str]:
    return [command for command, _ in next_steps(folder, found, stopped or [])]


def test_where_nothing_runs_it_shows_three_steps_to_a_first_run(umo: Umo, tmp_path: Path) -> None:
    result = umo()
    assert result.exit_code == 0
    assert "no station is running" in result.stdout
    assert commands(tmp_path, []) == ["umo run ztheta --realtime", "umo check ztheta", "umo new station my-machine"]
    assert all(command in result.stdout for command in commands(tmp_path, []))


@pytest.mark.parametrize(("failed", "named"), [("furnace", "furnace"), ("tank", "tank"), ("gone", "ztheta")])
def test_the_station_that_failed_is_the_one_to_run_again(tank: Path, tmp_path: Path, failed: str, named: str) -> None:
    folder = tmp_path if failed == "tank" else tmp_path / "elsewhere"
    found = [command for command, _ in next_steps(folder, [], [], [failed])]
    assert found == [f"umo show why {failed}", f"umo run {named} --realtime", f"umo check {named}"]


def test_in_a_station_it_shows_how_to_check_and_run_it(umo: Umo, tank: Path, tmp_path: Path) -> None:
    assert commands(tank, [])[:2] == ["umo run . --realtime", "umo check ."]
    assert commands(tmp_path, [])[:2] == ["umo run tank --realtime", "umo check tank"]


@pytest.mark.parametrize(
    ("state", "first"),
    [
        ({}, "umo show values press"),
        ({"alarms": 2}, "umo alarm list press"),
        ({"faults": {"ram": "it stuck"}}, "umo do press clear"),
    ],
)
def test_what_waits_for_somebody_comes_first(tmp_path: Path, state: dict[str, Any], first: str) -> None:
    found = commands(tmp_path, [run("press", **state)])
    assert found[0] == first
    assert len(found) == 3


@pytest.mark.parametrize(("count", "told"), [(1, "1 alarm is not normal"), (2, "2 alarms are not normal")])
def test_alarms_are_counted_in_words(tmp_path: Path, count: int, told: str) -> None:
    assert next_steps(tmp_path, [run("press", alarms=count)], [])[0][1] == told


def test_what_stands_stopped_is_to_be_acknowledged(tmp_path: Path) -> None:
    assert commands(tmp_path, [], [SimpleNamespace(station="press")])[0] == "umo do press acknowledge"


def test_steps_are_named_once_and_leave_room_for_what_runs(tmp_path: Path) -> None:
    stopped = [SimpleNamespace(station="press")] * 9
    assert commands(tmp_path, [run("tank")], stopped)[0] == "umo show values tank"
    found = commands(tmp_path, [run("tank", alarms=1, faults={"ram": "it stuck"})], stopped)
    assert found == ["umo alarm list tank", "umo do tank clear", "umo show values tank"]
    assert commands(tmp_path, [], stopped)[1] == "umo run ztheta --realtime"


def recorded_run(folder: Path, name: str, **summary: Any) -> None:
    place = folder / "runs" / name
    place.mkdir(parents=True)
    (place / "run.json").write_text(json.dumps({"station": name.partition("-")[0]}))
    if summary:
        (place / "summary.json").write_text(json.dumps(summary))


def test_a_run_that_failed_is_named_with_its_reason_until_a_later_one_has_not(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    recorded_run(tmp_path, "press-20260101-000000", status=1, failure="the ram stuck")
    recorded_run(tmp_path, "tank-20260101-000000", status=1, failure="empty")
    recorded_run(tmp_path, "tank-20260102-000000", status=143)
    found = umo().stdout
    assert "failed: press-20260101-000000 ended with status 1: the ram stuck" in found
    assert "umo show why press" in found
    assert "tank" not in found
    assert "press-20260101-000000 ended with status 1: the ram stuck" in umo("show", "why", "press").stdout


def test_a_run_without_a_summary_was_killed(umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recorded_run(tmp_path, "press-20260101-000000")
    assert "failed: press-20260101-000000 was killed" in umo().stdout


def test_of_many_that_stand_stopped_the_newest_are_shown(umo: Umo, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = [Ended(f"port {n}", "press", "", "stopped", float(n)) for n in range(8)]
    monkeypatch.setattr(stations, "all_standing", lambda: ended)
    found = umo("show", "stations").stdout
    assert [line.split(", ")[2] for line in found.splitlines() if "must be acknowledged: " in line] == [
        f"port {n}" for n in (7, 6, 5, 4, 3)
    ]
    assert "3 more must be acknowledged" in found


def test_a_station_that_runs_is_shown(umo: Umo, tmp_path: Path) -> None:
    found = commands(tmp_path, [run("press")])
    assert found == ["umo show values press", "umo do press", "umo show why press"]
