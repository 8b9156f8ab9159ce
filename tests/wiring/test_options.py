"""The options of a run reach whoever takes them, however the run is started."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers.tiers import some
from umo.process.job import Job, Plan
from umo.testing import station
from umo.wiring import distribute_options, resolve

APPLICATION = """
from enum import Enum
from pathlib import Path


class Mode(Enum):
    SLOW = "slow"
    FAST = "fast"


async def main(m, strokes: int = 3, mode: Mode = Mode.FAST, file: Path = Path("a"), level: float = 1.0):
    assert (strokes, mode, file, level) == (7, Mode.SLOW, Path("b"), 25.0), (strokes, mode, file, level)
    assert m.level.read() > 24.0  # the plant took the option of the same name
"""
GIVEN: dict[str, Any] = {"strokes": 7, "mode": "slow", "file": Path("b"), "level": 25.0}


def _by_run(tank: Path, **options: Any) -> None:
    found = station(tank)
    umo.run(found.machine(), found.wiring(None), found.main, **options)


def _by_drive(tank: Path, **options: Any) -> None:
    found = station(tank)
    with umo.connect(found.machine(), found.wiring(None), level=options.get("level", 20.0)) as m:
        umo.drive(m, found.main, **options)


def _by_start(tank: Path, **options: Any) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("umo.start needs Linux")
    with umo.start(tank, realtime=True, **options) as machine:
        machine.wait()


def _by_command(tank: Path, **options: Any) -> None:
    Plan(Job.load(Job(str(tank), options=options).dump()))  # what `umo run` does with its words: test_cli.py


WAYS = [_by_run, _by_drive, _by_start, _by_command]


@pytest.mark.parametrize("way", WAYS)
def test_each_option_reaches_all_who_take_one_of_its_name(tank: Path, way: Callable[..., None]) -> None:
    (tank / "application.py").write_text(APPLICATION)
    way(tank, **GIVEN)


@pytest.mark.parametrize("way", some(lambda way: way is not _by_start, WAYS))  # test_start.py has that one
def test_a_misspelt_option_is_named_with_the_nearest_one(tank: Path, way: Callable[..., None]) -> None:
    (tank / "application.py").write_text(APPLICATION)
    with pytest.raises(umo.UmoError, match=r"--stroke: unknown option \(did you mean 'strokes'\?\)"):
        way(tank, stroke=7)


def test_an_option_of_a_driver_that_the_wiring_misspells_is_left_to_the_wirings_faults() -> None:
    wiring = {"drivers": {"box": {"type": "modbsu"}}, "wire": {"valve": {"driver": "box"}}}
    assert distribute_options({"port": 5020}, wiring=wiring).wiring == {}


def test_the_options_of_a_wiring_that_is_resolved_are_refused(tank: Path) -> None:
    machine = station(tank).machine()
    wired = resolve(machine, None)
    with pytest.raises(umo.errors.OptionError, match="--seed: unknown option"):
        umo.connect(machine, wired, seed=3).__enter__()
