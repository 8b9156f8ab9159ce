"""`umo` alone: what runs here, and the next steps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import Result

from umo_command.home import next_steps

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
    assert commands(tmp_path, []) == ["umo run ztheta", "umo check ztheta", "umo new station my-machine"]
    assert all(command in result.stdout for command in commands(tmp_path, []))


def test_in_a_station_it_shows_how_to_check_and_run_it(umo: Umo, tank: Path, tmp_path: Path) -> None:
    assert commands(tank, [])[:2] == ["umo run .", "umo check ."]
    assert commands(tmp_path, [])[:2] == ["umo run tank", "umo check tank"]


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


def test_a_station_that_runs_is_shown(umo: Umo, tmp_path: Path) -> None:
    found = commands(tmp_path, [run("press")])
    assert found == ["umo show values press", "umo do press", "umo show why press"]
