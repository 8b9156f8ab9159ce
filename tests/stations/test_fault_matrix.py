"""Every station that ships ends every fault on every object in a way that has a word."""

from __future__ import annotations

import pytest

from helpers.tiers import first, named
from tools import fault_matrix as matrix
from umo.errors import AxisError

pytest.importorskip("mujoco")


def declared(station: str) -> set[tuple[str, str]]:
    """The faults that the machine cannot notice."""
    return {(path, kind) for path, (kinds, _) in matrix.TRIALS[station].unseen.items() for kind in kinds}


SOME = [  # the quick ones: test-all runs all of them
    ("conveyor", "sorter.belt.speed stuck at 2.2 s", "stopped"),
    ("conveyor", "sorter.belt.run disconnect at 0.5 s", "not reached"),
    ("conveyor", "sorter.diverter stuck at 0.5 s", "not seen"),
    ("conveyor", "sorter.entry wrong length at 2.2 s", "stopped"),
    ("conveyor", "timer bit flip at 0.5 s", "stopped"),
    ("conveyor", "sorter.belt.speed noise at 0.5 s", "ok"),
    ("furnace", "zones.2.temperature disconnect at 5 s", "degraded"),
    ("furnace", "zones.1.heater stuck at 5 s", "stopped"),
    ("furnace", "timer out of range at 70 s", "stopped"),
    ("furnace off the cycle", "zones.1.temperature disconnect at 5 s", "degraded"),
    ("furnace off the cycle", "zones.1.heater disconnect at 5 s", "not reached"),
    ("ztheta", "z.encoder stuck at 2 s", "stopped"),
    ("batch", "reactors.0.temperature disconnect at 10 s", "stopped"),
    ("batch", "line.inlets.1 stuck at 10 s", "stopped"),
    ("batch", "reactors.1.stirrer stuck at 10 s", "not seen"),
]


@pytest.mark.parametrize(("station", "fault", "verdict"), first(7, named([f"{s}: {f}" for s, f, _ in SOME], SOME)))
def test_a_station_ends_a_fault_as_it_should(station: str, fault: str, verdict: str) -> None:
    wanted = next(cell for cell in matrix.cells(station) if cell.fault == fault)
    done = matrix.tried(wanted, 200_000)
    assert done.verdict == verdict, done.detail


@pytest.mark.full
def test_a_run_that_forks_when_the_fault_begins_ends_as_one_with_the_fault_from_its_start() -> None:
    """In every word of the result or the error."""
    kinds = ("stuck", "noise", "bit flip", "disconnect")
    forked = matrix.all_tried([cell for cell in matrix.cells("conveyor", "sorter.belt.speed") if cell.kind in kinds], 1)
    assert {(cell.kind, cell.moment) for cell in forked} >= {("stuck", 0.5), ("stuck", 2.2), ("disconnect", 0.5)}
    for cell in forked:
        alone = matrix.tried(cell, 200_000)
        assert (cell.verdict, cell.detail) == (alone.verdict, alone.detail), cell.fault


@pytest.mark.full
@pytest.mark.parametrize("station", ["ztheta", "furnace", "furnace off the cycle", "conveyor", "batch"])
def test_no_fault_on_an_object_of_a_station_ends_in_a_defect(station: str) -> None:
    done = matrix.all_tried(matrix.cells(station), 1)
    assert [f"{cell.fault}: {cell.verdict}: {cell.detail}" for cell in done if cell.verdict not in matrix.WORDS] == []
    verdicts = {(cell.station, cell.fault): cell.verdict for cell in done}
    assert {(of, fault): verdicts[of, fault] for of, fault, _ in SOME if of == station} == {
        (of, fault): verdict for of, fault, verdict in SOME if of == station
    }
    seen = {(matrix.generalised(cell.path), cell.kind) for cell in done if cell.verdict == "not seen"}
    assert declared(station) - seen == set(), "these faults are noticed"


def test_the_page_has_a_row_for_an_object_with_a_word_for_each_moment_and_the_reasons() -> None:
    kinds = {("stuck", 0.5): "stopped", ("stuck", 2.2): "ok", ("noise", 0.5): "ok", ("bit flip", 0.5): "not seen"}
    done = [matrix.Cell("conveyor", "sorter.diverter", *kind, verdict=verdict) for kind, verdict in kinds.items()]
    page = matrix.page(done)
    assert [line[3:] for line in page.splitlines() if line.startswith("## ")] == list(matrix.TRIALS)
    assert "| sorter.diverter | stopped, ok | ok | - | - | not seen | - | - | - | - | - | - |" in page
    assert "- `sorter.diverter`: no sensor sees the diverter, or the parts behind it." in page


def test_each_kind_of_defect_is_told_apart() -> None:
    """A matrix that cannot fail proves nothing."""
    trial = matrix.TRIALS["conveyor"]
    run = matrix.carried_out(trial, ["timer noise 0"], 100_000)
    assert matrix.judged(trial, run, "timer", "noise")[0] == "ok"
    run.plant.accepted.pop()
    assert matrix.judged(trial, run, "timer", "noise")[0] == "WRONG"
    run.error = ZeroDivisionError("a mistake")
    assert matrix.judged(trial, run, "timer", "noise")[0] == "TRACEBACK"
    run.error, run.stopped = AxisError("stopped while it hung"), True
    assert matrix.judged(trial, run, "timer", "noise")[0] == "HANG"
    run.seen[matrix.SHOWN] = "idle is shown, in fault"
    assert matrix.judged(trial, run, "timer", "noise") == ("WRONG", "idle is shown, in fault")
    run.levels["sorter.belt.run"] = 1
    assert matrix.judged(trial, run, "timer", "noise") == ("UNSAFE", "not at the default: sorter.belt.run")
    del run.seen[matrix.SHOWN]
    assert matrix.judged(trial, run, "sorter.belt.run", "stuck")[0] == "HANG", "it was sent its default"
    run.sent["sorter.belt.run"] = 1
    assert matrix.judged(trial, run, "sorter.belt.run", "stuck")[0] == "UNSAFE"
    assert matrix.tried(next(iter(matrix.cells("conveyor"))), 10).verdict == "HANG"


def test_an_actuator_without_a_fault_that_is_not_reached_is_a_defect() -> None:
    trial = matrix.TRIALS["conveyor"]
    run = matrix.carried_out(trial, ["sorter.belt.run disconnect at 0.5 s"], 100_000)
    assert matrix.judged(trial, run, "sorter.belt.run", "disconnect")[0] == "not reached"
    assert matrix.judged(trial, run, "sorter.entry", "disconnect") == ("UNSAFE", "not at the default: sorter.belt.run")


def test_a_length_that_is_not_that_of_the_part_is_a_wrong_result() -> None:
    trial = matrix.TRIALS["conveyor"]
    run = matrix.carried_out(trial, ["timer noise 0"], 100_000)
    run.result["lengths_mm"][0] += 3.0
    verdict, detail = matrix.judged(trial, run, "timer", "noise")
    assert (verdict, detail[:12]) == ("WRONG", "a length is ")


def test_what_is_not_seen_is_declared_for_objects_that_exist() -> None:
    for name in matrix.TRIALS:
        assert declared(name) <= {(matrix.generalised(cell.path), cell.kind) for cell in matrix.cells(name)}
