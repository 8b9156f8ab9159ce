"""Every station that ships ends every fault on every object in a way that docs/fault-matrix.md names."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[1] / "docs"

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def matrix() -> Iterator[Any]:
    """docs/fault_matrix.py, where its processes find it too."""
    sys.path.insert(0, str(DOCS))
    yield importlib.import_module("fault_matrix")
    sys.path.remove(str(DOCS))


def rows(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("| ")]


SOME = [
    ("conveyor", "belt.speed stuck at 2.2 s", "stopped"),
    ("conveyor", "belt.run disconnect at 0.5 s", "not reached"),
    ("conveyor", "diverter stuck at 0.5 s", "not seen"),
    ("conveyor", "entry wrong length at 2.2 s", "stopped"),
    ("conveyor", "timer bit flip at 0.5 s", "stopped"),
    ("conveyor", "belt.speed noise at 0.5 s", "ok"),
    ("furnace", "zones.2.temperature disconnect at 5 s", "degraded"),
    ("furnace", "zones.1.heater stuck at 5 s", "stopped"),
    ("furnace", "timer out of range at 70 s", "stopped"),
    ("ztheta", "z.encoder stuck at 2 s", "stopped"),
    ("ztheta", "pressure_solenoid stuck at 2 s", "degraded"),
    ("ztheta", "gripper.vacuum stuck at 9.4 s", "stopped"),
]


@pytest.mark.parametrize(("station", "fault", "verdict"), SOME, ids=[f"{s}: {f}" for s, f, _ in SOME])
def test_a_station_ends_a_fault_as_it_should(matrix: Any, station: str, fault: str, verdict: str) -> None:
    wanted = next(cell for cell in matrix.cells(station) if cell.fault == fault)
    done = matrix.tried(wanted, 200_000)
    assert done.verdict == verdict, done.detail


@pytest.mark.slow
def test_the_page_of_the_fault_matrix_is_what_the_runs_give(matrix: Any) -> None:
    """All cells. Another processor may compute the last bits otherwise, so a few cells may differ, but none may be a
    defect."""
    done = matrix.all_tried([cell for name in matrix.TRIALS for cell in matrix.cells(name)])
    assert [f"{cell.fault}: {cell.verdict}: {cell.detail}" for cell in done if cell.verdict not in matrix.WORDS] == []
    unused = {path for trial in matrix.TRIALS.values() for path in trial.unseen} - {
        matrix.generalised(cell.path) for cell in done if cell.verdict == "not seen"
    }
    assert unused == set(), "no fault of these objects goes unseen any more"
    made, page = rows(matrix.page(done)), rows((DOCS / "fault-matrix.md").read_text("utf-8"))
    assert len(made) == len(page), "run: python docs/fault_matrix.py"
    changed = [line for line, written in zip(made, page, strict=True) if line != written]
    assert len(changed) <= 3, "run: python docs/fault_matrix.py"


def test_each_kind_of_defect_is_told_apart(matrix: Any) -> None:
    """A matrix that cannot fail proves nothing."""
    trial = matrix.TRIALS["conveyor"]
    run = matrix.carried_out(trial, ["timer noise 0"], 100_000)
    assert matrix.judged(trial, run, "timer", "noise")[0] == "ok"
    run.plant.accepted.pop()
    assert matrix.judged(trial, run, "timer", "noise")[0] == "WRONG"
    run.ended = False
    assert matrix.judged(trial, run, "timer", "noise")[0] == "HANG"
    run.error = ZeroDivisionError("a mistake")
    assert matrix.judged(trial, run, "timer", "noise")[0] == "TRACEBACK"
    next(iter(run.wired.drivers.values())).levels["drive:run"] = 1
    assert matrix.judged(trial, run, "timer", "noise")[0] == "UNSAFE"
    assert matrix.tried(next(iter(matrix.cells("conveyor"))), 10).verdict in ("HANG", "stopped")


def test_what_is_not_seen_is_declared_for_objects_that_exist(matrix: Any) -> None:
    for name, trial in matrix.TRIALS.items():
        cells = {(matrix.generalised(cell.path), cell.kind) for cell in matrix.cells(name)}
        declared = {(path, kind) for path, (kinds, _) in trial.unseen.items() for kind in kinds}
        assert declared <= cells
